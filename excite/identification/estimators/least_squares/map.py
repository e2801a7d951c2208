"""The most probable parameters given the data and the nominal model, no other constraint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from excite.identification.constraints.linear import stack_constraints
from excite.identification.estimators.base import Estimate, Estimator
from excite.identification.estimators.checked import checked_estimate, finite_or_raised
from excite.identification.estimators.ridge import ridge
from excite.identification.estimators.settings import EstimatorSettings, PullSettings
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import condense_problem, iterate_weights


@dataclass(frozen=True)
class MapSettings(PullSettings):
    """Settings of ``map``: the pull to the nominal model and its spreads."""


class MaximumAPosteriori(Estimator[MapSettings]):
    """The unconstrained minimum of eq. (4) of Jovic et al. 2015, in closed form.

    Predicts better than plain least squares where the motion is short; its bodies need not be able to exist.
    """

    name: ClassVar[str] = "map"
    title: ClassVar[str] = "least squares, pulled to the nominal model where the data say little"
    use: ClassVar[str] = "short motions of which only predictions matter: bodies need not be able to exist"
    settings_class: ClassVar[type[EstimatorSettings]] = MapSettings
    guarantees: ClassVar[str] = (
        "the global minimum of the weighted residual plus the weighted distance from the nominal model, in closed "
        "form; bodies need not be able to exist"
    )

    def estimate(self, problem: IdentificationProblem, settings: MapSettings) -> Estimate:
        """See :meth:`Estimator.estimate`."""
        rows = iterate_weights(condense_problem(problem))
        objective = ridge(rows, settings)
        nothing = stack_constraints([], len(objective.free))
        return finite_or_raised(checked_estimate(self.name, rows, objective, objective.target, 0.0, nothing))
