"""Physically consistent parameters: every pseudo-inertia positive definite, as a cone program.

Wensing, Kim and Slotine (IEEE RA-L 2018): a body of positive density exists exactly where its pseudo-inertia
is positive definite, which the inertia's definiteness alone does not ensure (triangle inequality).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from excite.identification.constraints.assemble import model_constraints
from excite.identification.constraints.body import pseudo_inertia_cones
from excite.identification.estimators.base import Estimate, Estimator
from excite.identification.estimators.conic.conic import ConicSolver, interior_point
from excite.identification.estimators.conic.conic_estimate import conic_estimate, consistent_or_raised
from excite.identification.estimators.entropic.entropic import entropic_estimate
from excite.identification.estimators.entropic.entropic_newton import newton_steps
from excite.identification.estimators.entropic.entropic_problem import EntropicSolver
from excite.identification.estimators.entropic.geometric import pullback_metric
from excite.identification.estimators.ridge import ridge
from excite.identification.estimators.setting import word
from excite.identification.estimators.settings import (
    BodySettings,
    EstimatorSettings,
    PullSettings,
    SymmetrySettings,
)
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, condense_problem, iterate_weights, prior_std


@dataclass(frozen=True)
class LmiSettings(SymmetrySettings, BodySettings, PullSettings):
    """Settings of ``lmi``.

    Attributes:
        regulariser: distance from the nominal model; ``pullback`` and ``entropic`` are those of Lee, Wensing and
            Park 2020, which do not depend on units or frames.
    """

    regulariser: str = word(
        "euclidean", ("euclidean", "pullback", "entropic"), "distance from the nominal model"
    )


class PhysicallyConsistent(Estimator[LmiSettings]):
    """The objective and linear constraints of ``qp`` with every pseudo-inertia positive definite.

    ``regulariser`` chooses the distance from the nominal model: ``euclidean`` in units of the spreads,
    ``pullback`` and ``entropic`` of :mod:`~excite.identification.estimators.entropic.geometric`. The entropic one keeps
    bodies inside the cone by itself and uses no ``inertia_floor``.
    """

    name: ClassVar[str] = "lmi"
    title: ClassVar[str] = "as qp, with physically consistent bodies (pseudo-inertia cones)"
    consistent: ClassVar[bool] = True
    use: ClassVar[str] = (
        "models to simulate or to control with: near the nominal model, and every body can exist"
    )
    settings_class: ClassVar[type[EstimatorSettings]] = LmiSettings
    guarantees: ClassVar[str] = (
        "within the stated distance of the global optimum; every body can exist (least eigenvalue of its "
        "pseudo-inertia at least -1e-9, recomputed), and masses and boxes hold, the total mass where it "
        "was weighed or the record tells it, symmetry where it is asked for"
    )

    def __init__(self, solver: ConicSolver = interior_point, entropic: EntropicSolver = newton_steps):
        self._solver, self._entropic = solver, entropic

    def estimate(self, problem: IdentificationProblem, settings: LmiSettings) -> Estimate:
        """See :meth:`Estimator.estimate`."""
        return self.solve(iterate_weights(condense_problem(problem)), settings)

    def solve(self, rows: Regression, settings: LmiSettings) -> Estimate:
        """Estimate from rows that have been condensed and weighted.

        Args:
            rows: the rows.
            settings: of this method.

        Raises:
            NoSolutionError: no parameters meet the constraints, or an answer fails its recomputation.
        """
        problem = rows.problem
        model = model_constraints(rows, settings)
        metric = None
        if settings.regulariser != "euclidean":
            spreads = settings.spreads(problem.robot)
            metric = pullback_metric(problem, spreads, prior_std(problem, spreads))
        objective = ridge(rows, settings, metric)
        if settings.regulariser == "entropic":
            best = entropic_estimate(self.name, rows, objective, model.linear, settings, self._entropic)
        else:
            cones = (pseudo_inertia_cones(problem, settings.inertia_floor),)
            best = conic_estimate(self.name, rows, objective, model.linear, cones, self._solver)
        return replace(consistent_or_raised(best), total_mass=model.total_mass)
