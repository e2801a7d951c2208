"""Physically consistent parameters: every pseudo-inertia positive definite, as a cone program.

Wensing, Kim and Slotine (IEEE RA-L 2018): a body of positive density exists exactly where its pseudo-inertia
is positive definite, which the inertia's definiteness alone does not ensure (triangle inequality).
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from excite.identification.constraints.assemble import model_constraints
from excite.identification.constraints.body import pseudo_inertia_cones
from excite.identification.estimators.base import Estimate, Estimator
from excite.identification.estimators.conic.conic import ConicSolver, interior_point
from excite.identification.estimators.conic.conic_estimate import conic_estimate, consistent_or_raised
from excite.identification.estimators.entropic.entropic import entropic_estimate
from excite.identification.estimators.entropic.entropic_newton import newton
from excite.identification.estimators.entropic.entropic_problem import EntropicSolver
from excite.identification.estimators.entropic.geometric import pullback_metric
from excite.identification.estimators.ridge import ridge
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, iterate_weights, prior_std, regression


class PhysicallyConsistent(Estimator):
    """The objective and linear constraints of ``qp`` with every pseudo-inertia positive definite.

    ``regulariser`` chooses the distance from the nominal model: ``euclidean`` in units of the spreads,
    ``pullback`` and ``entropic`` of :mod:`~excite.identification.estimators.entropic.geometric`. The entropic one keeps
    bodies inside the cone by itself and uses no ``inertia_floor``.
    """

    name: ClassVar[str] = "lmi"
    title: ClassVar[str] = "as qp, with physically consistent bodies (pseudo-inertia cones)"
    consistent: ClassVar[bool] = True
    guarantees: ClassVar[str] = (
        "within the stated distance of the global optimum; every body can exist (least eigenvalue of its "
        "pseudo-inertia at least -1e-9, recomputed), and masses, total mass, boxes and symmetry hold"
    )

    def __init__(self, solver: ConicSolver = interior_point, entropic: EntropicSolver = newton):
        self._solver, self._entropic = solver, entropic

    def estimate(self, problem: IdentificationProblem, settings: EstimatorSettings) -> Estimate:
        """See :meth:`Estimator.estimate`; uses every setting of ``qp`` but ``sphere_subdivisions``, and
        ``regulariser``."""
        return self.solve(iterate_weights(regression(problem)), settings)

    def solve(self, rows: Regression, settings: EstimatorSettings) -> Estimate:
        """Estimate from rows that have been condensed and weighted.

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
