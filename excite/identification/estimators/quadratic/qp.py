"""The constrained quadratic program of eq. (4), Jovic et al., Humanoids 2015."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from excite.arrays import Array
from excite.errors import NoSolutionError
from excite.identification.constraints.assemble import model_constraints
from excite.identification.constraints.inertia_cone import InertiaCone, inertia_cone
from excite.identification.constraints.linear import LinearConstraints, stack_constraints
from excite.identification.estimators.base import Estimate, Estimator, SolveStatus
from excite.identification.estimators.checked import checked_estimate, no_solution
from excite.identification.estimators.fallback import best_known
from excite.identification.estimators.quadratic.active_set import ActiveSetProjector
from excite.identification.estimators.quadratic.projection import Projector, distance_to_optimum
from excite.identification.estimators.ridge import Ridge, ridge
from excite.identification.estimators.settings import (
    BodySettings,
    EstimatorSettings,
    PullSettings,
    SphereSettings,
    SymmetrySettings,
)
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, condense_problem, iterate_weights

_MAX_ROUNDS = 60
_CONE_TOLERANCE = 1e-3


@dataclass(frozen=True)
class QpSettings(SymmetrySettings, BodySettings, SphereSettings, PullSettings):
    """Settings of ``qp``: the pull, boxes, symmetry, and the inertias' rows."""


class QuadraticProgram(Estimator[QpSettings]):
    """Least squares with a pull to the nominal model, under the linear constraints of Jovic et al. 2015.

    Channels are weighted as in ``wls``. Scaling of the pull: see
    :class:`~excite.identification.estimators.ridge.Ridge`.
    """

    name: ClassVar[str] = "qp"
    title: ClassVar[str] = "constrained quadratic program of Jovic et al. 2015"
    use: ClassVar[str] = (
        "comparison with the paper: standard parameters near the nominal model, from short motions too; bodies that "
        "cannot exist are named in the result"
    )
    settings_class: ClassVar[type[EstimatorSettings]] = QpSettings
    guarantees: ClassVar[str] = (
        "within the stated distance of the global optimum; masses not negative, boxes of the centres of mass and "
        "positive definite inertias about the joint frames hold, the total mass where it was weighed or the record "
        "tells it, symmetry where it is asked for; the triangle inequality need not"
    )

    def __init__(self, projector: Projector | None = None):
        self._projector = projector

    def estimate(self, problem: IdentificationProblem, settings: QpSettings) -> Estimate:
        """See :meth:`Estimator.estimate`."""
        rows = iterate_weights(condense_problem(problem))
        objective = ridge(rows, settings)
        model = model_constraints(rows, settings)
        cone = inertia_cone(problem, settings.inertia_floor, settings.sphere_subdivisions)
        rotated, reached = objective.constraints(model.linear), None
        projector = self._projector or ActiveSetProjector()
        for _ in range(_MAX_ROUNDS):
            answer = projector(objective.target, rotated)
            if answer is None:
                raise _failure(rows, objective, model.linear, cone, SolveStatus.INFEASIBLE, None)
            reached = answer.z
            distance = distance_to_optimum(objective.target, rotated, answer)
            best = checked_estimate(self.name, rows, objective, answer.z, distance, rotated)
            best = replace(best, total_mass=model.total_mass)
            if best.status is not SolveStatus.SOLVED:
                raise _failure(rows, objective, model.linear, cone, best.status, reached)
            cuts = cone.cuts(best.parameters, _CONE_TOLERANCE)
            if not len(cuts.bound):
                return best
            rotated = stack_constraints([rotated, objective.constraints(cuts)], len(objective.target))
        raise _failure(rows, objective, model.linear, cone, SolveStatus.CUT_LIMIT, reached)


def _failure(
    rows: Regression,
    objective: Ridge,
    linear: LinearConstraints,
    cone: InertiaCone,
    status: SolveStatus,
    answer: Array | None,
) -> NoSolutionError:
    """The error with the best point known."""
    rotated = objective.constraints(linear)

    def violations(z: Array) -> dict[str, float]:
        cuts = cone.cuts(objective.parameters(z), _CONE_TOLERANCE)
        both = stack_constraints([rotated, objective.constraints(cuts)], len(z))
        worst: dict[str, float] = {}
        for label, value in zip(both.labels, both.violations(z), strict=True):
            kind = label.split(":")[0]
            worst[kind] = max(worst.get(kind, 0.0), float(value))
        return worst

    goals = [] if answer is None else [answer]
    best = best_known(QuadraticProgram.name, rows, objective, linear, goals, violations)
    # Nothing but a point that meets everything refutes a solver that finds none.
    if status is not SolveStatus.INFEASIBLE:
        best = replace(best, status=status)
    return no_solution(best.status, best)
