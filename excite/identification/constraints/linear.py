"""Linear constraints on parameters, with names for every row."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np
import pinocchio as pin

from excite.arrays import Array, Flags
from excite.errors import InputError
from excite.identification.estimators.settings import BoxSettings, EstimatorSettings, SymmetrySettings
from excite.identification.inertia import (
    COLUMNS,
    NAMES,
    ROWS,
    STEINER,
    central_inertia_matrices,
    parameters_of_pseudo_inertia,
    pseudo_inertia_matrices,
)
from excite.identification.physical.bounds import KnownBounds, PhysicalBounds
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, least_squares, minimum_norm
from excite.robot.robot import Robot
from excite.robot.shapes.shape import joints_at


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

    def only(self, mask: Flags) -> LinearConstraints:
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


Entry = tuple[Mapping[int, float], float, str]
"""A row: factors by column, bound, and what it says, ``kind:segment``."""


def listed_rows(n_params: int, entries: Iterable[Entry], n_equal: int = 0) -> LinearConstraints:
    """Constraints from their entries, the first ``n_equal`` of which are equalities."""
    listed = list(entries)
    matrix = np.zeros((len(listed), n_params))
    for row, (factors, _, _) in zip(matrix, listed, strict=True):
        row[list(factors)] = list(factors.values())
    bound = np.array([float(bound) for _, bound, _ in listed])
    return LinearConstraints(matrix, bound, tuple(label for _, _, label in listed), n_equal)


def bound_between(factors: Mapping[int, float], low: float, high: float, label: str) -> tuple[Entry, Entry]:
    """Entries of ``low ≤ factors · θ ≤ high``."""
    return (factors, low, label), ({column: -factor for column, factor in factors.items()}, -high, label)


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
        bounds: ``(2, n_params)``.
        places: which of a segment's ten parameters, all parameters (drives' too) if None.

    Raises:
        InputError: bounds of another shape, NaN, or a lower one above its upper one.
    """
    bounds, names = np.asarray(bounds, dtype=float), problem.parameter_names
    what, remedy = "", None
    if bounds.shape != (2, problem.n_params):
        what, remedy = f"has shape {bounds.shape}", f"give (2, {problem.n_params})"
    elif not (bounds[0] <= bounds[1]).all():
        what = f"leaves nothing for {names[int(np.argmin(bounds[0] <= bounds[1]))]}"
    if what:
        raise InputError(what, source="settings", field="parameter_bounds", remedy=remedy)
    columns = np.arange(problem.n_params)
    if places is not None:
        columns = columns[: problem.n_inertial][np.isin(columns[: problem.n_inertial] % 10, places)]
    sides = ((1.0, bounds[0]), (-1.0, -bounds[1]))
    return listed_rows(
        problem.n_params,
        (
            ({j: sign}, side[j], f"bounds:{names[j]}")
            for sign, side in sides
            for j in columns.tolist()
            if np.isfinite(side[j])
        ),
    )


# The centre of mass lies inside a box (eq. 10 and 11 of Jovic et al., T-RO 2016).

_SMALLEST_HALF = 0.01


def com_in_box(problem: IdentificationProblem, boxes: Array) -> LinearConstraints:
    """``lower·m ≤ (mx, my, mz) ≤ upper·m`` for each segment.

    Args:
        boxes: lower and upper corners in the joint frames ``(n_segments, 2, 3)`` [m].
    """
    return listed_rows(
        problem.n_params,
        (
            ({10 * k: -sign * corner[axis], 10 * k + 1 + axis: sign}, 0.0, f"com_box:{segment.link}")
            for k, (segment, box) in enumerate(zip(problem.robot.segments, boxes, strict=True))
            for axis in range(3)
            for sign, corner in zip((1.0, -1.0), box, strict=True)
        ),
    )


def equivalent_boxes(robot: Robot, *, growth: float = 1.5) -> Array:
    """Boxes for segments whose geometry is not at hand: uniform boxes of the nominal mass and inertia.

    A uniform box of edges a, b, c has ``Ixx = m(b² + c²)/12``; the moments about the nominal centre of mass
    along the joint axes give the edges back.

    Args:
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
# A total mass is known when its standard deviation is below this share of it: forces under the feet have a tenth of
# that, and what joint torques say of the mass may be worth nothing.
_KNOWN = 0.01


def non_negative_masses(problem: IdentificationProblem) -> LinearConstraints:
    """``m_i ≥ 0`` for every segment, and every drive's friction and armature ≥ 0."""
    names = problem.parameter_names
    return listed_rows(
        problem.n_params, (({j: 1.0}, 0.0, f"non_negative:{names[j]}") for j in problem.non_negative)
    )


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


def known_total_mass(rows: Regression, settings: EstimatorSettings) -> float | None:
    """The weighed mass, else what the measured forces determine, else None [kg]."""
    if settings.total_mass is not None:
        return settings.total_mass
    measured = measured_total_mass(rows)
    return measured.value if measured.std < _KNOWN * abs(measured.value) else None


def total_mass(problem: IdentificationProblem, mass: float | None) -> LinearConstraints:
    """``Σ m_i = mass`` over all segments, those that the sensors do not see included; nothing of None."""
    factors = dict.fromkeys(range(0, problem.n_inertial, 10), 1.0)
    known = [] if mass is None else [(factors, mass, "total_mass:robot")]
    return listed_rows(problem.n_params, known, len(known))


def body_constraints(problem: IdentificationProblem, settings: BoxSettings) -> LinearConstraints:
    """The constraints of eq. (4) of Jovic et al. 2015 on masses and centres of mass, but for the total mass.

    Args:
        settings: boxes of the centres of mass.
    """
    boxes = settings.com_boxes if settings.com_boxes is not None else equivalent_boxes(problem.robot)
    return stack_constraints([non_negative_masses(problem), com_in_box(problem, boxes)], problem.n_params)


def model_constraints(problem: IdentificationProblem, settings: SymmetrySettings) -> LinearConstraints:
    """Those of :func:`body_constraints`, and symmetry if asked for.

    Raises:
        UnknownNameError: a link that need not mirror its twin is no segment.
    """
    parts = [body_constraints(problem, settings)]
    if settings.symmetry is not None:
        free = settings.free_of_symmetry(problem.robot)
        parts.append(symmetric_pairs(problem, settings.symmetry, free))
    return stack_constraints(parts, problem.n_params)


# Stated bounds of physical parameters as rows on the standard ones, for methods that are linear in these.


def stated_bounds(
    problem: IdentificationProblem, known: KnownBounds, usual: PhysicalBounds
) -> LinearConstraints:
    """Rows that every body within the stated bounds meets.

    Masses, the total mass, drives and centres of mass (``lower·m ≤ mc ≤ upper·m``) exactly. Moments and
    products of inertia are bounded about the centre of mass, from where the way to the joint frame is not
    linear: what they can be about it, over all masses and centres of mass within the bounds, is demanded, so
    that no allowed body is cut off but some others pass.

    Args:
        known: what is stated.
        usual: bounds of what is not, for the reach of masses and centres of mass.
    """
    bounds, entries = known.over(usual), list[Entry]()
    for k, segment in enumerate(problem.robot.segments):
        if k in problem.unmeasured:
            continue
        least, greatest = _steiner_bounds(bounds.lower[k], bounds.upper[k])
        for name, (low, high) in known.of(segment.link).items():
            place, label = NAMES.index(name), f"stated:{segment.link}.{name}"
            column, mass = 10 * k + place, 10 * k
            if 0 < place < 4:
                entries += [({column: 1.0, mass: -low}, 0.0, label), ({column: -1.0, mass: high}, 0.0, label)]
            else:
                # A mass has no such part.
                part = max(place - 4, 0)
                reach = (least[part], greatest[part]) if place else (0.0, 0.0)
                entries += bound_between({column: 1.0}, low + reach[0], high + reach[1], label)
    names = problem.parameter_names
    for name, pair in known.drives.items():
        if name in names:
            entries += bound_between({names.index(name): 1.0}, *pair, f"stated:{name}")
    if known.total_mass is not None:
        total = dict.fromkeys(range(0, problem.n_inertial, 10), 1.0)
        entries += bound_between(total, *known.total_mass, "stated:total_mass")
    return listed_rows(problem.n_params, entries)


def speaks_of(problem: IdentificationProblem, known: KnownBounds) -> list[int]:
    """Columns of the parameters whose bounds are stated."""
    links = [segment.link for segment in problem.robot.segments]
    columns = [10 * k + NAMES.index(name) for k, link in enumerate(links) for name in known.of(link)]
    names = problem.parameter_names
    return columns + [names.index(name) for name in known.drives if name in names]


def _steiner_bounds(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Least and greatest of what the mass at the centre of mass adds to the six inertias, ``(6,)`` each.

    Args:
        lower: ``(10,)`` bounds of one segment.
        upper: ``(10,)``.
    """
    corners = np.stack([lower[1:4], upper[1:4]])
    products = (corners[:, None, ROWS] * corners[None, :, COLUMNS]).reshape(4, 6)
    # A product of one coordinate with itself is not negative.
    least = np.where(ROWS == COLUMNS, np.maximum(products.min(axis=0), 0.0), products.min(axis=0))
    terms = np.stack([STEINER * least, STEINER * products.max(axis=0)])
    masses = np.array([[lower[0]], [upper[0]]])
    return (
        (masses * terms.min(axis=0).sum(axis=1)).min(axis=0),
        (masses * terms.max(axis=0).sum(axis=1)).max(axis=0),
    )


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
    entries = list[Entry]()
    ten = problem.prior[: problem.n_inertial].reshape(-1, 10)
    for index, other, mirror in mirrored_segments(problem, free):
        label = f"symmetry:{problem.robot.segments[index].link}"
        nominal = ten[other, :4] - mirror[:4, :4] @ ten[index, :4]
        moments = 0.5 * np.linalg.norm(ten[[index, other], 1:4], axis=1).sum()
        sizes = [0.5 * (ten[index, 0] + ten[other, 0]), moments, moments, moments]
        for axis, (middle, size) in enumerate(zip(nominal, sizes, strict=True)):
            factors = {10 * index + k: -float(mirror[axis, k]) for k in range(4)}
            factors[10 * other + axis] = factors.get(10 * other + axis, 0.0) + 1.0
            pair = bound_between(factors, middle - tolerance * size, middle + tolerance * size, label)
            entries += pair if tolerance > 0.0 else pair[:1]
    return listed_rows(problem.n_params, entries, len(entries) if tolerance == 0.0 else 0)


def mirrored_parameters(robot: Robot, left: int, right: int) -> Array:
    """``(10, 10)``: parameters of a right segment that is the mirror image of a left one.

    With the mirror image ``x ↦ T x`` of homogeneous points the pseudo-inertia becomes ``T J Tᵀ``.
    """
    data = joints_at(robot.model, pin.neutral(robot.model))
    base = data.oMi[1] if robot.floating else pin.SE3.Identity()
    a, b = (base.actInv(data.oMi[robot.segments[side].joint]) for side in (left, right))
    transform = np.eye(4)
    transform[:3, :3] = b.rotation.T @ _MIRROR @ a.rotation
    transform[:3, 3] = b.rotation.T @ (_MIRROR @ a.translation - b.translation)
    unit = pseudo_inertia_matrices(np.eye(10).ravel())
    return np.column_stack([parameters_of_pseudo_inertia(transform @ j @ transform.T) for j in unit])
