"""The hierarchical quadratic program of Jovic et al., IEEE Transactions on Robotics 2016."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.identification.constraints.assemble import body_constraints
from excite.identification.constraints.linear import LinearConstraints, stack_constraints
from excite.identification.constraints.mass_range import masses_in_range
from excite.identification.constraints.mirror import mirrored_pairs
from excite.identification.constraints.sphere import SphereRows
from excite.identification.estimators.base import Estimate, Estimator, SolveStatus
from excite.identification.estimators.checked import no_solution
from excite.identification.estimators.fallback import best_feasible, plain_models
from excite.identification.estimators.quadratic.active_set import ActiveSetProjector
from excite.identification.estimators.quadratic.hierarchy import solve_hierarchy
from excite.identification.estimators.quadratic.hierarchy_state import HierarchyAnswer, Level
from excite.identification.estimators.quadratic.projection import Projector
from excite.identification.estimators.scaled import Scaled, scaled_parameters
from excite.identification.estimators.setting import number, shares_by_link
from excite.identification.estimators.settings import (
    BoxSettings,
    EstimatorSettings,
    PairSettings,
    SphereSettings,
    known_segments,
)
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, condense_problem, iterate_weights, least_squares
from excite.robot.robot import Robot

# Largest violation of a vector's row that is let pass, as a share of ε.
_CUT_TOLERANCE = 1e-6
_VIOLATION = 1e-6


@dataclass(frozen=True)
class HqpSettings(BoxSettings, PairSettings, SphereSettings):
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
    on 10 242 vectors; the second eq. 15 and 16. Two choices differ from the paper: channels are weighted as in
    ``wls``, and distances to ``φ_ref`` and violations of rows are counted in units of the spreads, since a sum
    of squares of kilograms and of kg·m² would leave every inertia to chance. Each level is solved by
    active-set quadratic programs to which violated vectors are added until all 10 242 hold.

    The inertia is taken about the joint frame, as in the paper, so the level does not tie it to mass and
    centre of mass: some of the bodies that come out cannot exist.
    """

    name: ClassVar[str] = "hqp"
    title: ClassVar[str] = "hierarchical quadratic program of Jovic et al. 2016"
    use: ClassVar[str] = (
        "people and humanoids on force plates, as in the paper: constraints come before the data, sides mirror each "
        "other where they are not said to be asymmetric, masses keep a range"
    )
    settings_class: ClassVar[type[EstimatorSettings]] = HqpSettings
    guarantees: ClassVar[str] = (
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

    def estimate(self, problem: IdentificationProblem, settings: HqpSettings) -> Estimate:
        """See :meth:`Estimator.estimate`."""
        return self.solve(iterate_weights(condense_problem(problem)), settings)

    def solve(self, rows: Regression, settings: HqpSettings) -> Estimate:
        """Estimate from rows that have been condensed and weighted.

        Args:
            rows: the rows.
            settings: of this method.

        Raises:
            NoSolutionError: level one cannot be met, or an answer fails its recomputation.
        """
        scaled = scaled_parameters(rows, settings)
        factor = rows.factor
        matrix = scaled.columns(factor[:, :-1])
        measured = factor[:, -1] - factor[:, :-1] @ scaled.center
        levels = self._levels(rows, settings, scaled)
        start = np.zeros(len(scaled.free))
        if levels and isinstance(levels[0].family, ScaledSphere):
            start = levels[0].family.start()
        answer = solve_hierarchy(levels, matrix, measured, self._projector or ActiveSetProjector(), start)
        best = self._estimate(rows, settings, scaled, levels, answer)
        if best.status is not SolveStatus.SOLVED:
            x = _best_known(rows, settings, scaled, levels, answer.x)
            status = best.status
            if x is not None:
                best = self._estimate(rows, settings, scaled, levels, replace(answer, x=x))
                # A point that meets level one refutes that there is none.
                status = SolveStatus.NOT_OPTIMAL if status is SolveStatus.INFEASIBLE else status
            raise no_solution(status, replace(best, status=status))
        return best

    def _estimate(
        self,
        rows: Regression,
        settings: HqpSettings,
        scaled: Scaled,
        levels: tuple[Level, ...],
        answer: HierarchyAnswer,
    ) -> Estimate:
        """The answer with everything recomputed from the parameters."""
        problem = rows.problem
        parameters = scaled.parameters(answer.x)
        worst: dict[str, float] = {}
        active: list[str] = []
        for level in levels:
            violation = level.constraints.violations(answer.x)
            slack = level.constraints.matrix @ answer.x - level.constraints.bound
            for label, value, left in zip(level.constraints.labels, violation, slack, strict=True):
                kind = label.split(":")[0]
                worst[kind] = max(worst.get(kind, 0.0), float(value))
                if left < _VIOLATION:
                    active.append(label)
        status = answer.status
        if status is SolveStatus.SOLVED:
            status = _recomputed_status(levels, answer, worst)
        if not np.isfinite(parameters).all():
            status = SolveStatus.NOT_FINITE
        weighted = problem.residual(parameters) / rows.std[problem.channel]
        return Estimate(
            method=self.name,
            parameters=parameters,
            status=status,
            regression=rows,
            residual=float(np.sqrt(np.mean(weighted**2))),
            distance=answer.fit_distance,
            violations=worst,
            active=tuple(dict.fromkeys(active)),
            total_mass=settings.total_mass,
        )


def _best_known(
    rows: Regression, settings: HqpSettings, scaled: Scaled, levels: tuple[Level, ...], x: Array
) -> Array | None:
    """Of points that meet the first level the one that misses the second least, then fits best."""
    problem, family = rows.problem, levels[0].family if levels else None
    models = plain_models(problem, body_constraints(rows, settings).linear)
    if isinstance(family, ScaledSphere):
        models = [family.sphere.lifted(model) for model in models]

    def violation(point: Array) -> float:
        worst = max(
            (float(level.constraints.violations(point).max(initial=0.0)) for level in levels[:1]), default=0
        )
        missed = family is not None and len(family.violated(point).bound)
        return np.inf if missed else worst

    def cost(point: Array) -> tuple[float, ...]:
        lower = [float(np.linalg.norm(level.constraints.violations(point))) for level in levels[1:]]
        residual = problem.residual(scaled.parameters(point)) / rows.std[problem.channel]
        return (*lower, float(np.linalg.norm(residual)))

    free = least_squares(rows.factor, center=scaled.center, scales=scaled.scales)
    return best_feasible(
        [scaled.coordinates(model) for model in models], [x, scaled.coordinates(free)], violation, cost
    )


def _recomputed_status(
    levels: tuple[Level, ...], answer: HierarchyAnswer, worst: dict[str, float]
) -> SolveStatus:
    if levels and answer.slacks[0] > _VIOLATION:
        return SolveStatus.INFEASIBLE
    for level, reached in zip(levels, answer.slacks, strict=True):
        left = float(np.linalg.norm(level.constraints.violations(answer.x)))
        missed = level.family is not None and len(level.family.violated(answer.x).bound)
        if left > reached + _VIOLATION or missed:
            return SolveStatus.VIOLATED
    return SolveStatus.SOLVED


def paper_levels(rows: Regression, settings: HqpSettings, scaled: Scaled) -> tuple[Level, ...]:
    """The two constraint levels of eq. (7): eq. 8–14, and eq. 15 and 16."""
    problem = rows.problem
    sphere = SphereRows(problem, settings.sphere_epsilon, settings.sphere_subdivisions)
    model = body_constraints(rows, settings).linear

    first = Level("feasible", scaled.constraints(model), ScaledSphere(sphere, scaled))
    parts = [masses_in_range(problem, settings.mass_ranges(problem.robot))]
    if settings.mirror is not None:
        parts.append(mirrored_pairs(problem, settings.mirror, settings.free_of_symmetry(problem.robot)))
    second = Level("plausible", scaled.constraints(stack_constraints(parts, problem.n_params)))
    return first, second


@dataclass(frozen=True, eq=False)
class ScaledSphere:
    """The rows of a sphere on scaled parameters, all of unit length.

    Attributes:
        sphere: the rows in parameters.
        scaled: the scales.
    """

    sphere: SphereRows
    scaled: Scaled

    def start(self) -> Array:
        """Nominal parameters with inertias raised until all rows hold, ``(n_free,)``."""
        raised = self.sphere.lifted(self.scaled.center)
        return ((raised - self.scaled.center) / self.scaled.scales)[self.scaled.free]

    def violated(self, x: Array) -> LinearConstraints:
        """Some of the rows that ``x`` violates; none when all hold."""
        tolerance = _CUT_TOLERANCE * self.sphere.epsilon + 1e-12
        return self.scaled.constraints(self.sphere.cuts(self.scaled.parameters(x), tolerance))
