"""Linear constraints on parameters, with names for every row."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import InputError
from excite.identification.estimators.settings import BoxSettings, EstimatorSettings, SymmetrySettings
from excite.identification.inertia import (
    COLUMNS,
    ROWS,
    central_inertia_matrices,
    parameters_of_pseudo_inertia,
    pseudo_inertia_matrices,
)
from excite.identification.physical.bounds import Interval, KnownBounds, PhysicalBounds
from excite.identification.physical.coordinates import NAMES, STEINER
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, least_squares, minimum_norm
from excite.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class LinearConstraints:
    """``matrix · θ ≥ bound``; the first ``n_equal`` rows hold with equality.

    Rows are scaled so that a row's value is in the unit of a mass [kg] per unit of its ``scale``: a
    violation of one is as serious as a kilogram that is missing.

    Attributes:
        matrix: ``(n_rows, n_params)``.
        bound: ``(n_rows,)``.
        labels: what each row says, ``kind:segment``.
        n_equal: number of leading rows that are equalities.
    """

    matrix: Array
    bound: Array
    labels: tuple[str, ...]
    n_equal: int = 0

    def violations(self, parameters: Array) -> Array:
        """How far each row is violated, ``(n_rows,)``, zero where it holds."""
        slack = self.matrix @ parameters - self.bound
        violation = np.maximum(-slack, 0.0)
        violation[: self.n_equal] = np.abs(slack[: self.n_equal])
        return violation

    def only(self, mask: NDArray[np.bool_]) -> LinearConstraints:
        """The rows of a mask ``(n_rows,)``, all as inequalities."""
        return LinearConstraints(self.matrix[mask], self.bound[mask], tuple(compress(self.labels, mask)))

    def worst_violations(self, parameters: Array) -> dict[str, float]:
        """Largest violation of each kind of row."""
        found: dict[str, float] = {}
        for label, value in zip(self.labels, self.violations(parameters), strict=True):
            kind = label.partition(":")[0]
            found[kind] = max(found.get(kind, 0.0), float(value))
        return found

    def labels_reached(self, parameters: Array, tolerance: float) -> tuple[str, ...]:
        """Labels of the rows that hold with no more than ``tolerance`` to spare."""
        near = self.matrix @ parameters - self.bound < tolerance
        return tuple(dict.fromkeys(compress(self.labels, near)))


def unit_rows(
    matrix: Array, bound: Array, labels: Sequence[str] | None = None, n_equal: int = 0, least: float = 0.0
) -> LinearConstraints:
    """Constraints with rows of unit length; rows that are no longer than ``least`` are left out.

    Args:
        matrix: ``(n_rows, n)``.
        bound: ``(n_rows,)``.
        labels: what each row says; nothing if None.
        n_equal: number of leading rows that are equalities.
        least: length of a row that says nothing.
    """
    length = np.linalg.norm(matrix, axis=1)
    kept = length > least
    names = [""] * len(bound) if labels is None else labels
    return LinearConstraints(
        matrix[kept] / length[kept, None],
        bound[kept] / length[kept],
        tuple(compress(names, kept)),
        int(kept[:n_equal].sum()),
    )


def stack_constraints(parts: Sequence[LinearConstraints], n_params: int) -> LinearConstraints:
    """Join constraints, equalities first.

    Args:
        parts: constraints on the same parameters; their order is kept.
        n_params: number of parameters, for where there are no parts.
    """
    equal = [(p.matrix[: p.n_equal], p.bound[: p.n_equal], p.labels[: p.n_equal]) for p in parts]
    other = [(p.matrix[p.n_equal :], p.bound[p.n_equal :], p.labels[p.n_equal :]) for p in parts]
    pieces = equal + other
    return LinearConstraints(
        np.vstack([piece[0] for piece in pieces] or [np.zeros((0, n_params))]),
        np.concatenate([piece[1] for piece in pieces] or [np.zeros(0)]),
        tuple(label for piece in pieces for label in piece[2]),
        sum(p.n_equal for p in parts),
    )


# Lower and upper bounds on single parameters (Golluccio et al. 2020, CLS-1 and CLS-2).

MASS_AND_FIRST_MOMENT = (0, 1, 2, 3)


def bounds_about_nominal(problem: IdentificationProblem, spread: Array, width: float) -> Array:
    """Nominal values plus and minus ``width`` spreads, masses and drives' friction and armature not negative.

    Args:
        problem: the problem.
        spread: ``(n_params,)``.
        width: half width in spreads.

    Returns:
        ``(2, n_params)``.
    """
    bounds = problem.prior + width * spread * np.array([[-1.0], [1.0]])
    positive = problem.non_negative
    bounds[0, positive] = np.maximum(bounds[0, positive], 0.0)
    return np.asarray(bounds)


def within_bounds(
    problem: IdentificationProblem, bounds: Array, places: tuple[int, ...] | None = None
) -> LinearConstraints:
    """``lower ≤ θ ≤ upper`` for every finite bound.

    Args:
        problem: the problem.
        bounds: ``(2, n_params)``.
        places: which of a segment's ten parameters, all parameters (drives' too) if None.

    Raises:
        InputError: bounds of another shape, NaN, or a lower one above its upper one.
    """
    bounds = np.asarray(bounds, dtype=float)
    if bounds.shape != (2, problem.n_params):
        raise InputError(
            f"has shape {bounds.shape}",
            source="settings",
            field="parameter_bounds",
            remedy=f"give (2, {problem.n_params})",
        )
    wrong = np.flatnonzero(~(bounds[0] <= bounds[1]))
    if len(wrong):
        raise InputError(
            f"leaves nothing for {problem.parameter_names[wrong[0]]}",
            source="settings",
            field="parameter_bounds",
        )
    columns = np.arange(problem.n_params)
    if places is not None:
        columns = columns[: problem.n_inertial]
        columns = columns[np.isin(columns % 10, places)]
    identity = np.eye(problem.n_params)[columns]
    lower, upper = bounds[0, columns], bounds[1, columns]
    below, above = np.isfinite(lower), np.isfinite(upper)
    names = np.array(problem.parameter_names)[columns]
    labels = [f"bounds:{name}" for name in (*names[below], *names[above])]
    return LinearConstraints(
        np.vstack([identity[below], -identity[above]]),
        np.concatenate([lower[below], -upper[above]]),
        tuple(labels),
    )


# The centre of mass lies inside a box (eq. 10 and 11 of Jovic et al., T-RO 2016).

_SMALLEST_HALF = 0.01


def com_in_box(problem: IdentificationProblem, boxes: Array) -> LinearConstraints:
    """``lower·m ≤ (mx, my, mz) ≤ upper·m`` for each segment.

    Args:
        problem: the problem.
        boxes: lower and upper corners in the joint frames ``(n_segments, 2, 3)`` [m].
    """
    n = len(problem.robot.segments)
    matrix, labels = np.zeros((n, 3, 2, problem.n_params)), []
    for index, segment in enumerate(problem.robot.segments):
        for axis in range(3):
            for side, sign in enumerate((1.0, -1.0)):
                matrix[index, axis, side, 10 * index] = -sign * boxes[index, side, axis]
                matrix[index, axis, side, 10 * index + 1 + axis] = sign
                labels.append(f"com_box:{segment.link}")
    return LinearConstraints(matrix.reshape(-1, problem.n_params), np.zeros(6 * n), tuple(labels))


def equivalent_boxes(robot: Robot, *, growth: float = 1.5) -> Array:
    """Boxes for segments whose geometry is not at hand: uniform boxes of the nominal mass and inertia.

    A uniform box of edges a, b, c has ``Ixx = m(b² + c²)/12``; the moments about the nominal centre of mass
    along the joint axes give the edges back.

    Args:
        robot: the robot.
        growth: factor on the edges.

    Returns:
        Lower and upper corners in the joint frames ``(n_segments, 2, 3)`` [m].
    """
    ten = robot.nominal_parameters.reshape(-1, 10)
    moments = np.einsum("ijj->ij", central_inertia_matrices(robot.nominal_parameters))
    mass = np.maximum(ten[:, :1], 1e-9)
    squares = 6.0 * (moments.sum(axis=1, keepdims=True) - 2.0 * moments) / mass
    half = np.maximum(0.5 * growth * np.sqrt(np.maximum(np.nan_to_num(squares), 0.0)), _SMALLEST_HALF)
    center = ten[:, 1:4] / mass
    return np.stack([center - half, center + half], axis=1)


# Masses are not negative and add up to the total (eq. 8 and 9 of Jovic et al., T-RO 2016).

_IN_ROW_SPACE = 1e-6


def non_negative_masses(problem: IdentificationProblem) -> LinearConstraints:
    """``m_i ≥ 0`` for every segment, and every drive's friction and armature ≥ 0."""
    columns = problem.non_negative
    labels = tuple(f"non_negative:{problem.parameter_names[j]}" for j in columns)
    return LinearConstraints(np.eye(problem.n_params)[columns], np.zeros(len(columns)), labels)


@dataclass(frozen=True)
class TotalMass:
    """Mass of all segments as the measured forces say it.

    Attributes:
        value: [kg], unmeasured segments counted with their nominal mass.
        std: standard deviation [kg]; infinite where the rows do not determine the total mass.
        identifiable: whether the rows determine it.
    """

    value: float
    std: float
    identifiable: bool


def measured_total_mass(rows: Regression) -> TotalMass:
    """Total mass from the forces, where the rows determine it (a robot that stands; not an arm on a table).

    The sum of the masses is a combination of base parameters on a floating base, so the least-squares
    solution determines it whatever the individual masses are.
    """
    problem = rows.problem
    total = np.zeros(problem.n_params)
    total[: problem.n_inertial : 10] = 1.0
    seen = np.where(problem.is_moving, total, 0.0)
    a = rows.factor[:, :-1]
    norms = np.linalg.norm(a, axis=0)
    used = norms > 1e-12 * max(float(norms.max()), 1e-300)
    scaled, wanted = a[:, used] / norms[used], seen[used] / norms[used]
    influence = minimum_norm(scaled.T, wanted)
    missing = np.linalg.norm(scaled.T @ influence - wanted) / max(float(np.linalg.norm(wanted)), 1e-300)
    if missing > _IN_ROW_SPACE or bool(np.any(seen[~used] != 0.0)):
        return TotalMass(float(total @ problem.prior), float("inf"), False)
    scales = np.where(used, 1.0 / np.where(used, norms, 1.0), 0.0)
    fit = least_squares(rows.factor, center=problem.prior, scales=scales)
    inflation = 1.0 if rows.noise is None else float(rows.noise.inflation.max())
    return TotalMass(float(total @ fit), float(np.linalg.norm(influence) * np.sqrt(inflation)), True)


def total_mass(problem: IdentificationProblem, mass: float) -> LinearConstraints:
    """``Σ m_i = mass`` over all segments, those that the sensors do not see included."""
    row = np.zeros((1, problem.n_params))
    row[0, : problem.n_inertial : 10] = 1.0
    return LinearConstraints(row, np.array([mass]), ("total_mass:robot",), 1)


# All linear constraints of eq. (4) of Jovic et al., Humanoids 2015, from the settings.


@dataclass(frozen=True, eq=False)
class ModelConstraints:
    """Constraints on a robot's parameters.

    Attributes:
        linear: all linear rows.
        total_mass: mass that they impose on the sum [kg], None where it is free.
    """

    linear: LinearConstraints
    total_mass: float | None


def body_constraints(rows: Regression, settings: BoxSettings) -> ModelConstraints:
    """The constraints of eq. (4) on masses and centres of mass.

    The total mass is the weighed one, else what the measured forces determine, else free.

    Args:
        rows: condensed and weighted rows.
        settings: boxes of the centres of mass, weighed mass.
    """
    problem = rows.problem
    boxes = settings.com_boxes if settings.com_boxes is not None else equivalent_boxes(problem.robot)
    parts = [non_negative_masses(problem), com_in_box(problem, boxes)]
    mass = known_total_mass(rows, settings)
    if mass is not None:
        parts.append(total_mass(problem, mass))
    return ModelConstraints(stack_constraints(parts, problem.n_params), mass)


def model_constraints(rows: Regression, settings: SymmetrySettings) -> ModelConstraints:
    """All constraints of eq. (4) but the inertia's: those of :func:`body_constraints`, and symmetry if asked for.

    Args:
        rows: condensed and weighted rows.
        settings: those of :func:`body_constraints`, symmetry, and the links that are free of it.

    Raises:
        UnknownNameError: a link that need not mirror its twin is no segment.
    """
    bodies, problem = body_constraints(rows, settings), rows.problem
    if settings.symmetry is None:
        return bodies
    pairs = symmetric_pairs(problem, settings.symmetry, settings.free_of_symmetry(problem.robot))
    return replace(bodies, linear=stack_constraints([bodies.linear, pairs], problem.n_params))


# A total mass is known when its standard deviation is below this share of it: forces under the feet have a tenth of
# that, and what joint torques say of the mass may be worth nothing.
_KNOWN = 0.01


def known_total_mass(rows: Regression, settings: EstimatorSettings) -> float | None:
    """The weighed mass, else what the measured forces determine, else None [kg]."""
    if settings.total_mass is not None:
        return settings.total_mass
    measured = measured_total_mass(rows)
    return measured.value if measured.identifiable and measured.std < _KNOWN * abs(measured.value) else None


# Stated bounds of physical parameters as rows on the standard ones, for methods that are linear in these.

_MASS, _FIRST, _INERTIA = 0, slice(1, 4), 4


def stated_bounds(
    problem: IdentificationProblem, known: KnownBounds, usual: PhysicalBounds
) -> LinearConstraints:
    """Rows that every body within the stated bounds meets.

    Masses, the total mass, drives and centres of mass (``lower·m ≤ mc ≤ upper·m``) exactly. Moments and
    products of inertia are bounded about the centre of mass, from where the way to the joint frame is not
    linear: what they can be about it, over all masses and centres of mass within the bounds, is demanded, so
    that no allowed body is cut off but some others pass.

    Args:
        problem: the problem.
        known: what is stated.
        usual: bounds of what is not, for the reach of masses and centres of mass.
    """
    bounds = known.over(usual)
    builder = _Rows(problem)
    for k, segment in enumerate(problem.robot.segments):
        if k in problem.unmeasured:
            continue
        builder.body(
            10 * k, segment.link, known.of(segment.link), _steiner_bounds(bounds.lower[k], bounds.upper[k])
        )
    for name, pair in known.drives.items():
        if name in problem.parameter_names:
            builder.within({problem.parameter_names.index(name): 1.0}, pair, name)
    if known.total_mass is not None:
        total = dict.fromkeys(range(0, problem.n_inertial, 10), 1.0)
        builder.within(total, known.total_mass, "total_mass")
    return builder.constraints()


def speaks_of(problem: IdentificationProblem, known: KnownBounds) -> list[int]:
    """Columns of the parameters whose bounds are stated."""
    links = [segment.link for segment in problem.robot.segments]
    columns = [10 * k + NAMES.index(name) for k, link in enumerate(links) for name in known.of(link)]
    return columns + [
        problem.parameter_names.index(name) for name in known.drives if name in problem.parameter_names
    ]


def _steiner_bounds(lower: Array, upper: Array) -> Array:
    """Least and greatest of what the mass at the centre of mass adds to the six inertias, ``(2, 6)``.

    Args:
        lower: ``(10,)`` bounds of one segment.
        upper: ``(10,)``.
    """
    corners = np.stack([lower[_FIRST], upper[_FIRST]])
    products = np.array(
        [_product_bounds(corners[:, i], corners[:, j], i == j) for i, j in zip(ROWS, COLUMNS, strict=True)]
    )
    terms = np.stack([STEINER * products[:, 0], STEINER * products[:, 1]])
    least, greatest = terms.min(axis=0).sum(axis=1), terms.max(axis=0).sum(axis=1)
    masses = (lower[_MASS], upper[_MASS])
    return np.array(
        [
            np.minimum(least * masses[0], least * masses[1]),
            np.maximum(greatest * masses[0], greatest * masses[1]),
        ]
    )


def _product_bounds(first: Array, second: Array, same: bool) -> Interval:
    """Least and greatest product of two coordinates; of one with itself it is not negative."""
    corners = np.outer(first, second)
    if not same:
        return float(corners.min()), float(corners.max())
    squares = first**2
    return 0.0 if first[0] <= 0.0 <= first[1] else float(squares.min()), float(squares.max())


class _Rows:
    """Rows under construction."""

    def __init__(self, problem: IdentificationProblem):
        self._size = problem.n_params
        self._rows: list[Array] = []
        self._bound: list[float] = []
        self._labels: list[str] = []

    def at_least(self, terms: dict[int, float], bound: float, name: str) -> None:
        row = np.zeros(self._size)
        row[list(terms)] = list(terms.values())
        self._rows.append(row)
        self._bound.append(bound)
        self._labels.append(f"stated:{name}")

    def within(self, terms: dict[int, float], interval: Interval, name: str) -> None:
        self.at_least(terms, interval[0], name)
        self.at_least({column: -factor for column, factor in terms.items()}, -interval[1], name)

    def body(self, column: int, link: str, stated: dict[str, Interval], steiner: Array) -> None:
        """Rows of one segment, whose parameters start at ``column``."""
        for name, (low, high) in stated.items():
            place, label = NAMES.index(name), f"{link}.{name}"
            if place == _MASS:
                self.within({column: 1.0}, (low, high), label)
            elif place < _INERTIA:
                self.at_least({column + place: 1.0, column: -low}, 0.0, label)
                self.at_least({column + place: -1.0, column: high}, 0.0, label)
            else:
                reach = steiner[:, place - _INERTIA]
                self.within({column + place: 1.0}, (low + float(reach[0]), high + float(reach[1])), label)

    def constraints(self) -> LinearConstraints:
        rows = np.array(self._rows).reshape(-1, self._size)
        return LinearConstraints(rows, np.array(self._bound), tuple(self._labels))


# Left and right segments mirror each other (eq. 4, Jovic 2015; eq. 15, Jovic 2016).

_MIRROR = np.diag([1.0, -1.0, 1.0])


def mirrored_segments(
    problem: IdentificationProblem, free: Collection[int] = ()
) -> Iterator[tuple[int, int, Array]]:
    """Left and right segment of each pair that has to be symmetric, and the way from one's parameters to the other's.

    Args:
        problem: the problem; its robot says which segments are pairs.
        free: segments whose pairs are left out.
    """
    for index, segment in enumerate(problem.robot.segments):
        other = segment.pair
        if other is not None and other >= index and index not in free and other not in free:
            yield index, other, mirrored_parameters(problem.robot, index, other)


def symmetric_pairs(
    problem: IdentificationProblem, tolerance: float, free: Collection[int] = ()
) -> LinearConstraints:
    """Mass and first moments of paired segments differ by at most a share of their nominal size.

    The right first moment is compared with the left one mirrored at the base's sagittal (x–z) plane, with
    the robot in its zero configuration; the nominal model's own asymmetry is allowed for.

    Args:
        problem: the problem; its robot says which segments are pairs.
        tolerance: relative difference; at zero the rows are equalities.
        free: segments whose pairs have no rows.
    """
    rows: list[Array] = []
    bounds: list[float] = []
    labels: list[str] = []
    signs = (1.0, -1.0) if tolerance > 0.0 else (1.0,)
    ten = problem.prior[: problem.n_inertial].reshape(-1, 10)
    for index, other, mirror in mirrored_segments(problem, free):
        nominal = ten[other, :4] - mirror[:4, :4] @ ten[index, :4]
        sizes = (
            0.5 * (ten[index, 0] + ten[other, 0]),
            0.5 * np.linalg.norm(ten[[index, other], 1:4], axis=1).sum(),
        )
        for axis in range(4):
            row = np.zeros(problem.n_params)
            row[10 * other + axis] = 1.0
            row[10 * index : 10 * index + 4] -= mirror[axis, :4]
            rows += [sign * row for sign in signs]
            bounds += [sign * nominal[axis] - tolerance * sizes[axis > 0] for sign in signs]
            labels += [f"symmetry:{problem.robot.segments[index].link}"] * len(signs)
    matrix = np.array(rows).reshape(-1, problem.n_params)
    return LinearConstraints(matrix, np.array(bounds), tuple(labels), len(rows) if tolerance == 0.0 else 0)


def mirrored_parameters(robot: Robot, left: int, right: int) -> Array:
    """``(10, 10)``: parameters of a right segment that is the mirror image of a left one.

    With the mirror image ``x ↦ T x`` of homogeneous points the pseudo-inertia becomes ``T J Tᵀ``.
    """
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, pin.neutral(robot.model))
    a, b = data.oMi[robot.segments[left].joint], data.oMi[robot.segments[right].joint]
    base = data.oMi[1] if robot.floating else pin.SE3.Identity()
    a, b = base.actInv(a), base.actInv(b)
    transform = np.eye(4)
    transform[:3, :3] = b.rotation.T @ _MIRROR @ a.rotation
    transform[:3, 3] = b.rotation.T @ (_MIRROR @ a.translation - b.translation)
    unit = pseudo_inertia_matrices(np.eye(10).ravel())
    return np.column_stack([parameters_of_pseudo_inertia(transform @ j @ transform.T) for j in unit])
