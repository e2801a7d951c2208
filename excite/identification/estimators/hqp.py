"""Estimators by hierarchies of quadratic programs: Jovic et al. 2016, and CLS-1 of Golluccio et al. 2020."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.identification.constraints.linear import (
    Entry,
    LinearConstraints,
    body_constraints,
    bound_between,
    known_total_mass,
    listed_rows,
    mirrored_segments,
    stack_constraints,
    total_mass,
)
from excite.identification.estimators.estimator import (
    Estimate,
    Estimator,
    SolveStatus,
    best_feasible,
    estimate_at,
    no_solution,
    plain_models,
)
from excite.identification.estimators.hierarchy import HierarchyAnswer, Level, solve_hierarchy
from excite.identification.estimators.projection import ActiveSetProjector, Projector
from excite.identification.estimators.scaled_problem import Scaled, scaled_parameters
from excite.identification.estimators.settings import (
    BoxSettings,
    PairSettings,
    ParameterBoundsSettings,
    known_segments,
    shares_by_link,
)
from excite.identification.inertia import COLUMNS, DIAGONAL, ROWS, inertia_matrices
from excite.identification.physical.default_bounds import bound_rows, parameter_bounds
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import RANK_TOLERANCE, Regression, least_squares
from excite.regressor.base_parameters import base_parameters
from excite.robot.robot import Robot
from excite.rows.settings import number

# Each mass stays within a share of its reference (eq. 16 of Jovic et al., T-RO 2016).


def masses_in_range(problem: IdentificationProblem, shares: Array) -> LinearConstraints:
    """``(1 − β) m_ref ≤ m ≤ (1 + β) m_ref`` for each segment.

    Args:
        problem: the problem; its prior is the reference.
        shares: β of each segment, ``(n_segments,)``.
    """
    entries = list[Entry]()
    for k, segment in enumerate(problem.robot.segments):
        nominal, share = problem.prior[10 * k], shares[k]
        label = f"mass_range:{segment.link}"
        entries += bound_between({10 * k: 1.0}, (1.0 - share) * nominal, (1.0 + share) * nominal, label)
    return listed_rows(problem.n_params, entries)


# Left and right masses and moments of inertia differ by a share of each other (eq. 15, Jovic et al. 2016).


def mirrored_pairs(
    problem: IdentificationProblem, share: float, free: Collection[int] = ()
) -> LinearConstraints:
    """``(1 − α) x_j ≤ x_i ≤ (1 + α) x_j`` and the same with ``i`` and ``j`` exchanged.

    ``x`` are the mass and the three moments of inertia about the axes of the joint frame; those of the left
    segment are taken about the right segment's axes mirrored at the sagittal (x–z) plane of the base, with
    the robot in its zero configuration, so that the frames need not be mirror images themselves.

    Args:
        problem: the problem; its robot says which segments are pairs.
        share: α.
        free: segments whose pairs have no rows.
    """
    rows: list[Array] = []
    labels: list[str] = []
    unit = np.eye(problem.n_params)
    for index, other, mirror in mirrored_segments(problem, free):
        for place in (0, 4, 6, 9):
            left, right = mirror[place] @ unit[10 * index : 10 * index + 10], unit[10 * other + place]
            for near, far in ((right, left), (left, right)):
                rows += [near - (1.0 - share) * far, (1.0 + share) * far - near]
            labels += [f"mirror:{problem.robot.segments[index].link}"] * 4
    return LinearConstraints(np.array(rows).reshape(-1, problem.n_params), np.zeros(len(rows)), tuple(labels))


# Largest violation that is let pass: of a vector's row as a share of ε, of others as a share of a spread.
_VIOLATION = 1e-6


@dataclass(frozen=True, eq=False)
class InertiaFloor:
    """``vᵀ I v ≥ ε`` on every vector (eq. 13 of Jovic et al., T-RO 2016), ε absolute, for all free segments.

    The paper takes 10 242 vectors. Here rows are cutting planes, those of the eigenvectors of an answer whose
    eigenvalues are below ε.

    Attributes:
        problem: the problem.
        scaled: the scales of its parameters.
        epsilon: ε [kg·m²].
    """

    problem: IdentificationProblem
    scaled: Scaled
    epsilon: float

    def lifted(self, parameters: Array) -> Array:
        """A copy ``(n_params,)`` whose free inertias are raised by multiples of the identity until all rows hold."""
        raised = parameters.copy()
        least = np.linalg.eigvalsh(inertia_matrices(raised[: self.problem.n_inertial]))[:, 0]
        lift = np.maximum(1.01 * self.epsilon - least, 0.0)
        lift[list(self.problem.unmeasured)] = 0.0
        raised[: self.problem.n_inertial].reshape(-1, 10)[:, [4 + k for k in DIAGONAL]] += lift[:, None]
        return raised

    def violated(self, x: Array) -> LinearConstraints:
        """Rows that ``x`` violates; none when all hold."""
        problem = self.problem
        inertia = inertia_matrices(self.scaled.parameters(x)[: problem.n_inertial])
        values, vectors = np.linalg.eigh(inertia)
        below = values < (1.0 - _VIOLATION) * self.epsilon - 1e-12
        below[list(problem.unmeasured)] = False
        entries = list[Entry]()
        for k, which in np.argwhere(below).tolist():
            row = quadratic_row(vectors[k, :, which]).tolist()
            label = f"sphere:{problem.robot.segments[k].link}"
            entries.append((dict(zip(range(10 * k + 4, 10 * k + 10), row, strict=True)), self.epsilon, label))
        return self.scaled.constraints(listed_rows(problem.n_params, entries))


def quadratic_row(v: Array) -> Array:
    """Row ``w`` ``(6,)`` with ``w · (Ixx, Ixy, Iyy, Ixz, Iyz, Izz) = vᵀ I v`` (eq. 14)."""
    return np.asarray(v[ROWS] * v[COLUMNS] * np.where(ROWS == COLUMNS, 1.0, 2.0))


@dataclass(frozen=True)
class HqpSettings(BoxSettings, PairSettings):
    """Settings of ``hqp``, of eq. (13) to (16) of Jovic et al. 2016.

    Attributes:
        sphere_epsilon: the ε of eq. (13), absolute as there.
        mirror: the α of eq. (15); None leaves the left and right side free.
        mass_range: the β of eq. (16); there 0.35 for modified segments, 0.05 for others.
        segment_mass_range: ``mass_range`` of single segments, by link.
    """

    sphere_epsilon: float = number(0.01, "kg·m²", 0.0, 1e3, "least moment of inertia")
    mirror: float | None = number(0.1, "1", 0.0, 1.0, "relative left/right difference", optional=True)
    mass_range: float = number(0.35, "1", 0.0, 1e6, "range of masses about nominal, as share of them")
    segment_mass_range: Mapping[str, float] = shares_by_link(0.0, 1e6, "mass_range of single segments")

    def mass_ranges(self, robot: Robot) -> Array:
        """β of eq. (16) for each segment, ``(n_segments,)``; raises UnknownNameError for a link that is none."""
        known_segments(robot, self.segment_mass_range)
        return np.array([self.segment_mass_range.get(s.link, self.mass_range) for s in robot.segments])


LevelBuilder = Callable[[Regression, HqpSettings, Scaled], tuple[Level, ...]]


class HierarchicalProgram(Estimator[HqpSettings]):
    """Four levels (eq. 7): physical feasibility ≻ symmetry and mass ranges ≻ ``Yφ = f`` ≻ ``φ = φ_ref``.

    The first level is eq. 8–14: masses not negative, total mass, boxes of the centres of mass, ``vᵀ I v ≥ ε``
    on every vector; the second eq. 15 and 16. Two choices differ from the paper: channels are weighted as in
    ``wls``, and distances to ``φ_ref`` and violations of rows are counted in units of the spreads, since a sum
    of squares of kilograms and of kg·m² would leave every inertia to chance. Each level is solved by
    active-set quadratic programs to which rows of violated vectors are added until all hold.

    The inertia is taken about the joint frame, as in the paper, so the level does not tie it to mass and
    centre of mass: some of the bodies that come out cannot exist.
    """

    name = "hqp"
    title = "hierarchical quadratic program of Jovic et al. 2016"
    use = (
        "people and humanoids on force plates, as in the paper: constraints come before the data, sides mirror each "
        "other where they are not said to be asymmetric, masses keep a range"
    )
    settings_class = HqpSettings
    guarantees = (
        "no level's least sum of squared violations is made worse for a lower one; level one (masses, total mass, "
        "boxes, inertias on every vector of the sphere) holds or there is no result; level two holds as far as it "
        "can; the triangle inequality need not"
    )
    exempt: ClassVar[Mapping[str, str]] = {
        "prediction": "mass ranges come before the data, and an absolute ε is above small segments' own inertia"
    }

    def __init__(self, projector: Projector | None = None, levels: LevelBuilder | None = None):
        self._projector = projector
        self._levels = levels or paper_levels

    def solve(self, rows: Regression, settings: HqpSettings) -> Estimate:
        """See :meth:`Estimator.solve`.

        Raises:
            NoSolutionError: level one cannot be met, or an answer fails its recomputation.
        """
        scaled = scaled_parameters(rows, settings)
        factor = rows.factor
        matrix = scaled.columns(factor[:, :-1])
        measured = factor[:, -1] - factor[:, :-1] @ scaled.center
        levels = self._levels(rows, settings, scaled)
        start = np.zeros(len(scaled.free))
        if levels and isinstance(levels[0].family, InertiaFloor):
            start = scaled.coordinates(levels[0].family.lifted(scaled.center))
        answer = solve_hierarchy(levels, matrix, measured, self._projector or ActiveSetProjector(), start)
        best = self._recompute_estimate(rows, settings, scaled, levels, answer)
        if best.status is not SolveStatus.SOLVED:
            x = _best_known(rows, settings, scaled, levels, answer.x)
            status = best.status
            if x is not None:
                best = self._recompute_estimate(rows, settings, scaled, levels, replace(answer, x=x))
                # A point that meets level one refutes that there is none.
                status = SolveStatus.NOT_OPTIMAL if status is SolveStatus.INFEASIBLE else status
            raise no_solution(status, replace(best, status=status))
        return best

    def _recompute_estimate(
        self,
        rows: Regression,
        settings: HqpSettings,
        scaled: Scaled,
        levels: tuple[Level, ...],
        answer: HierarchyAnswer,
    ) -> Estimate:
        """The answer with everything recomputed from the parameters."""
        parameters = scaled.parameters(answer.x)
        rows_met = stack_constraints([level.constraints for level in levels], len(answer.x))
        worst = rows_met.worst_violations(answer.x)
        status = answer.status
        if status is SolveStatus.SOLVED:
            status = _recomputed_status(levels, answer)
        if not np.isfinite(parameters).all():
            status = SolveStatus.NOT_FINITE
        return replace(
            estimate_at(self.name, rows, parameters, status, worst),
            distance=answer.fit_distance,
            active=rows_met.labels_reached(answer.x, _VIOLATION),
            total_mass=settings.total_mass,
        )


def _best_known(
    rows: Regression, settings: HqpSettings, scaled: Scaled, levels: tuple[Level, ...], x: Array
) -> Array | None:
    """Of points that meet the first level the one that misses the second least, then fits best."""
    problem, family = rows.problem, levels[0].family if levels else None
    models = plain_models(problem, _feasibility_rows(rows, settings))
    if isinstance(family, InertiaFloor):
        models = [family.lifted(model) for model in models]

    def worst_violation(point: Array) -> float:
        worst = max(
            (float(level.constraints.violations(point).max(initial=0.0)) for level in levels[:1]), default=0
        )
        missed = family is not None and len(family.violated(point).bound)
        return np.inf if missed else worst

    def level_costs(point: Array) -> tuple[float, ...]:
        lower = [float(np.linalg.norm(level.constraints.violations(point))) for level in levels[1:]]
        residual = problem.residual(scaled.parameters(point)) / rows.std[problem.channel]
        return (*lower, float(np.linalg.norm(residual)))

    free = least_squares(rows.factor, center=scaled.center, scales=scaled.scales)
    return best_feasible(
        [scaled.coordinates(model) for model in models],
        [x, scaled.coordinates(free)],
        worst_violation,
        level_costs,
    )


def _recomputed_status(levels: tuple[Level, ...], answer: HierarchyAnswer) -> SolveStatus:
    if levels and answer.slacks[0] > _VIOLATION:
        return SolveStatus.INFEASIBLE
    for level, reached in zip(levels, answer.slacks, strict=True):
        left = float(np.linalg.norm(level.constraints.violations(answer.x)))
        missed = level.family is not None and len(level.family.violated(answer.x).bound)
        if left > reached + _VIOLATION or missed:
            return SolveStatus.VIOLATED
    return SolveStatus.SOLVED


def _feasibility_rows(rows: Regression, settings: HqpSettings) -> LinearConstraints:
    """Eq. 8 to 11: masses not negative, total mass, boxes of the centres of mass."""
    problem = rows.problem
    parts = [total_mass(problem, known_total_mass(rows, settings)), body_constraints(problem, settings)]
    return stack_constraints(parts, problem.n_params)


def paper_levels(rows: Regression, settings: HqpSettings, scaled: Scaled) -> tuple[Level, ...]:
    """The two constraint levels of eq. (7): eq. 8–14, and eq. 15 and 16."""
    problem = rows.problem
    floor = InertiaFloor(problem, scaled, settings.sphere_epsilon)
    first = Level("feasible", scaled.constraints(_feasibility_rows(rows, settings)), floor)
    parts = [masses_in_range(problem, settings.mass_ranges(problem.robot))]
    if settings.mirror is not None:
        parts.append(mirrored_pairs(problem, settings.mirror, settings.free_of_symmetry(problem.robot)))
    second = Level("plausible", scaled.constraints(stack_constraints(parts, problem.n_params)))
    return first, second


# Parameters within bounds nearest to the unconstrained base solution (CLS-1 of Golluccio et al. 2020).


class BoundedNearBase(Estimator[ParameterBoundsSettings]):
    """``bounds ≻ (π_b(π) = π̂_b) ≻ (π = π_nominal)``: CLS-1 with what it leaves open decided.

    ``π̂_b`` are the least-squares base parameters. The distance from them is the plain sum of squares of SI
    values, as in the paper: it counts a kilogram like a kg·m² and does not know how well each is determined,
    which is why the method predicts less well than others that use the same data. Among equals, the
    parameters nearest to nominal are given, in units of the spreads.
    """

    name = "cls1"
    title = "bounded parameters nearest to the unconstrained base solution (CLS-1)"
    use = (
        "comparison with published CLS-1 results: parameters within bounds; bodies need not be able to exist"
    )
    settings_class = ParameterBoundsSettings
    guarantees = (
        "every parameter within its bounds, and no others within them have base parameters nearer to the "
        "least-squares ones; bodies need not be able to exist"
    )
    exempt: ClassVar[Mapping[str, str]] = {
        "prediction": "nearest in parameters, not in what they predict (CLS-1 of Golluccio et al. 2020)"
    }

    def __init__(self, projector: Projector | None = None):
        self._projector = projector

    def solve(self, rows: Regression, settings: ParameterBoundsSettings) -> Estimate:
        """See :meth:`Estimator.solve`.

        Raises:
            InputError: bounds that leave nothing.
            NoSolutionError: an answer fails its recomputation.
        """
        problem = rows.problem
        scaled = scaled_parameters(rows, settings)
        bounds = parameter_bounds(rows, settings)
        level = Level("bounds", scaled.constraints(bound_rows(rows, settings)))
        n = problem.n_params
        base = base_parameters(rows.factor[:, :n], problem.parameter_names, RANK_TOLERANCE).matrix
        wanted = base @ (
            least_squares(rows.factor, center=scaled.center, scales=scaled.scales) - scaled.center
        )
        start = np.clip(scaled.center, *bounds)
        answer = solve_hierarchy(
            (level,),
            scaled.columns(base),
            wanted,
            self._projector or ActiveSetProjector(),
            ((start - scaled.center) / scaled.scales)[scaled.free],
        )
        worst, status = level.constraints.worst_violations(answer.x), answer.status
        if status is SolveStatus.SOLVED and max(worst.values(), default=0.0) > _VIOLATION:
            status = SolveStatus.VIOLATED
        parameters = scaled.parameters(answer.x)
        # What rounding leaves outside a bound is put onto it.
        if status is SolveStatus.SOLVED:
            parameters[scaled.free] = np.clip(parameters, *bounds)[scaled.free]
        best = replace(
            estimate_at(self.name, rows, parameters, status, worst),
            distance=answer.fit_distance,
            active=level.constraints.labels_reached(answer.x, _VIOLATION),
        )
        if status is not SolveStatus.SOLVED:
            raise no_solution(status, best)
        return best
