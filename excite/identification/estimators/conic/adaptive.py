"""The default: bodies that can exist, believed as far as the log supports the nominal model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from excite.identification.constraints.assemble import known_total_mass
from excite.identification.constraints.body import pseudo_inertia_cones
from excite.identification.constraints.linear import stack_constraints
from excite.identification.constraints.mass import total_mass
from excite.identification.estimators.base import Estimate, Estimator
from excite.identification.estimators.conic.conic import ConicSolver, interior_point
from excite.identification.estimators.conic.conic_estimate import conic_estimate, consistent_or_raised
from excite.identification.estimators.ridge import ridge
from excite.identification.estimators.setting import number, word
from excite.identification.estimators.settings import EstimatorSettings, PullSettings
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, condense_problem, iterate_weights


@dataclass(frozen=True)
class AdaptiveSettings(EstimatorSettings):
    """Settings of ``adaptive``.

    Attributes:
        alpha: the α of eq. (4) of Jovic et al. 2015, in units in which prior and noise have unit variance; None has
            :func:`~excite.identification.identify.identify` choose it for an arm, and is 1 elsewhere.
        terms: whether identify may add terms of drives and sensors to an arm's equations.
        inertia_floor: relative, so that it fits hands and trunks.
    """

    alpha: float | None = number(
        None, "1", 1e-12, 1e12, "weight of the nominal model against the data", optional=True
    )
    terms: str = word(
        "chosen",
        ("chosen", "stated"),
        "terms beside rigid bodies: those that the log asks for, or stated ones only",
    )
    inertia_floor: float = number(
        0.01, "1", 0.0, 0.9, "least moment of inertia, as share of the nominal least one of the segment"
    )


class Adaptive(Estimator[AdaptiveSettings]):
    """Pseudo-inertias positive definite (Wensing, Kim and Slotine 2018), near the nominal ones, and nothing else.

    Unlike ``lmi`` it keeps no centre of mass in a box of the link's shape, since people hang things on links, and no
    sign of a friction. What rigid bodies cannot explain is left to terms of drives and sensors where blocks of the
    log that are left out ask for them (:mod:`excite.identification.adaptation`): without these, bodies that can
    exist predict worse than least squares, and bodies that cannot take their place.
    """

    name: ClassVar[str] = "adaptive"
    title: ClassVar[str] = (
        "bodies that can exist, with the nominal model's weight and terms of drives and sensors that the log asks for"
    )
    consistent: ClassVar[bool] = True
    adapts: ClassVar[bool] = True
    use: ClassVar[str] = (
        "most logs: bodies that can exist, so that a model is always written, and predictions at least as good as "
        "least squares'"
    )
    settings_class: ClassVar[type[EstimatorSettings]] = AdaptiveSettings
    guarantees: ClassVar[str] = (
        "within the stated distance of the global optimum; every body can exist (least eigenvalue of its "
        "pseudo-inertia at least -1e-9, recomputed), and the total mass holds where it was weighed or the "
        "record tells it"
    )

    def __init__(self, solver: ConicSolver = interior_point):
        self._solver = solver

    def estimate(self, problem: IdentificationProblem, settings: AdaptiveSettings) -> Estimate:
        """See :meth:`Estimator.estimate`."""
        return self.solve(iterate_weights(condense_problem(problem)), settings)

    def solve(self, rows: Regression, settings: AdaptiveSettings) -> Estimate:
        """Estimate from rows that have been condensed and weighted.

        Args:
            rows: the rows.
            settings: of this method.

        Raises:
            NoSolutionError: no bodies meet the constraints, or an answer fails its recomputation.
        """
        alpha = 1.0 if settings.alpha is None else settings.alpha
        rows = replace(rows, problem=_steady_drives(rows.problem, alpha))
        problem = rows.problem
        pull = PullSettings(
            prior_spread=settings.prior_spread, segment_spread=settings.segment_spread, alpha=alpha
        )
        mass = known_total_mass(rows, settings)
        linear = stack_constraints([] if mass is None else [total_mass(problem, mass)], problem.n_params)
        cones = (pseudo_inertia_cones(problem, settings.inertia_floor),)
        best = conic_estimate(self.name, rows, ridge(rows, pull), linear, cones, self._solver)
        return replace(consistent_or_raised(best), total_mass=mass)


def _steady_drives(problem: IdentificationProblem, alpha: float) -> IdentificationProblem:
    """The problem whose drives keep their expected spread whatever the weight of the nominal bodies is."""
    if problem.drive_spread is None:
        return problem
    return replace(problem, drive_spread=np.sqrt(alpha) * problem.drive_spread)
