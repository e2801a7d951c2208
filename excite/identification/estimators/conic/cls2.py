"""Physically feasible inertias within bounds of mass and first moment (CLS-2 of Golluccio et al. 2020)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from excite.identification.constraints.body import feasibility_cones
from excite.identification.constraints.bounds import MASS_AND_FIRST_MOMENT
from excite.identification.constraints.linear import stack_constraints
from excite.identification.constraints.mass import non_negative_masses
from excite.identification.estimators.base import Estimate, Estimator
from excite.identification.estimators.conic.conic import ConicSolver, interior_point
from excite.identification.estimators.conic.conic_estimate import conic_estimate
from excite.identification.estimators.quadratic.cls1 import bound_rows
from excite.identification.estimators.ridge import ridge
from excite.identification.estimators.settings import (
    EstimatorSettings,
    ParameterBoundsSettings,
    PullSettings,
)
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, condense_problem, iterate_weights


@dataclass(frozen=True)
class Cls2Settings(ParameterBoundsSettings, PullSettings):
    """Settings of ``cls2``: the pull, the bounds of masses and first moments, the least inertia."""


class PhysicallyFeasible(Estimator[Cls2Settings]):
    """Least squares with a pull to nominal under eq. (3): ``m > 0`` and inertia about the centre of mass ``≻ 0``.

    Sousa and Cortesão's linear matrix inequality, with bounds on masses and first moments. The regularisation
    that the paper asks for is the pull of eq. (4) of Jovic et al. 2015, weight ``alpha``.
    """

    name: ClassVar[str] = "cls2"
    title: ClassVar[str] = "physically feasible inertias, bounded masses and first moments (CLS-2)"
    use: ClassVar[str] = (
        "comparison with published CLS-2 results: masses and first moments within bounds; bodies may break the "
        "triangle inequality"
    )
    settings_class: ClassVar[type[EstimatorSettings]] = Cls2Settings
    guarantees: ClassVar[str] = (
        "within the stated distance of the global optimum; masses positive, inertias about the centres of mass "
        "positive definite, masses and first moments within their bounds; the triangle inequality need not hold"
    )

    def __init__(self, solver: ConicSolver = interior_point):
        self._solver = solver

    def estimate(self, problem: IdentificationProblem, settings: Cls2Settings) -> Estimate:
        """See :meth:`Estimator.estimate`."""
        return self.solve(iterate_weights(condense_problem(problem)), settings)

    def solve(self, rows: Regression, settings: Cls2Settings) -> Estimate:
        """Estimate from rows that have been condensed and weighted.

        Args:
            rows: the rows.
            settings: of this method.

        Raises:
            InputError: bounds that leave nothing.
            NoSolutionError: no parameters meet the constraints, or an answer fails its recomputation.
        """
        problem = rows.problem
        bounds = bound_rows(rows, settings, MASS_AND_FIRST_MOMENT)
        linear = stack_constraints([non_negative_masses(problem), bounds], problem.n_params)
        cones = (feasibility_cones(problem, settings.inertia_floor),)
        return conic_estimate(self.name, rows, ridge(rows, settings), linear, cones, self._solver)
