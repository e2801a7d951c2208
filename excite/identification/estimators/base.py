"""What every estimator takes and gives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, Generic, TypeVar

from excite.arrays import Array
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.physical.certificate import Certificate
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression

SettingsT = TypeVar("SettingsT", bound=EstimatorSettings)


class SolveStatus(Enum):
    """How a solve ended; the value is advice."""

    SOLVED = "solved: optimality and constraints were recomputed from the answer"
    INFEASIBLE = (
        "no parameters meet all constraints; check the total mass and the boxes of the centres of mass, "
        "or loosen the symmetry"
    )
    NOT_OPTIMAL = "the solver stopped short of the optimum; raise alpha or use another method"
    VIOLATED = "the solver's answer breaks constraints that it was given; do not use it, try another method"
    CUT_LIMIT = (
        "positive definiteness was not reached within the allowed cuts; raise inertia_floor or use lmi"
    )
    NOT_FINITE = "the solver's answer is not finite; raise alpha or use another method"


@dataclass(frozen=True, eq=False)
class Estimate:
    """Parameters found by an estimator, with checks that do not come from its solver.

    Attributes:
        method: registry name of the estimator.
        parameters: ``(n_params,)``.
        status: how the solve ended.
        regression: the rows as the estimator weighted them.
        residual: root mean square of the weighted residual.
        distance: bound on the distance to the optimum, in standard deviations of the noise (0 where there
            is no solver to distrust).
        violations: largest violation of each kind of constraint (kg, or kg·m, kg·m²).
        active: labels of constraints that hold with equality.
        total_mass: mass to which the sum was tied [kg], None where it was free.
        certificate: what is proven of an objective that is not convex, None for convex ones.
    """

    method: str
    parameters: Array
    status: SolveStatus
    regression: Regression
    residual: float
    distance: float = 0.0
    violations: dict[str, float] | None = None
    active: tuple[str, ...] = ()
    total_mass: float | None = None
    certificate: Certificate | None = None


class Estimator(ABC, Generic[SettingsT]):
    """A way to parameters from an :class:`~excite.identification.problem.IdentificationProblem`.

    A new one is a file with a subclass and a line in
    :mod:`excite.identification.estimators.registry`.

    Attributes:
        name: registry name.
        title: what it is, in a few words.
        use: when to take it, in a line.
        settings_class: its settings, all that it knows and none that it ignores.
        consistent: whether its parameters are those of bodies that can exist.
        adapts: whether :func:`~excite.identification.identify.identify` chooses the nominal model's weight, and terms
            beside rigid bodies, by blocks of the log that are left out.
        guarantees: what holds for every result that is returned, recomputed from the parameters themselves.
        exempt: checks of the shared battery in the tests that it does not claim to pass, with the reason.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    use: ClassVar[str]
    settings_class: ClassVar[type[EstimatorSettings]] = EstimatorSettings
    consistent: ClassVar[bool] = False
    adapts: ClassVar[bool] = False
    guarantees: ClassVar[str] = ""
    exempt: ClassVar[Mapping[str, str]] = {}

    @abstractmethod
    def estimate(self, problem: IdentificationProblem, settings: SettingsT) -> Estimate:
        """Estimate the parameters.

        Args:
            problem: the rows; not changed.
            settings: of its ``settings_class``.

        Returns:
            The estimate, its residual recomputed.

        Raises:
            InputError: rows are not finite.
            NoSolutionError: no parameters were found that pass the checks; ``best`` is the best Estimate.
        """
