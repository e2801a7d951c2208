"""What an excitation is optimised for: smooth functions of the information matrix, with their derivatives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.errors import UnknownNameError

# Eigenvalues below this share of the largest are rounding; at the floor the criterion is flat.
_FLOOR = 1e-15


@dataclass(frozen=True, eq=False)
class CriterionValue:
    """A criterion at one information matrix.

    Attributes:
        value: what is minimised, a logarithm.
        gradient: ``(n, n)``, symmetric, its derivative in the information matrix.
    """

    value: float
    gradient: Array


@dataclass(frozen=True, eq=False)
class ParameterScale:
    """What the largest relative standard deviation is relative to.

    Attributes:
        size: ``(n_base,)`` magnitude of each base parameter [SI].
        std: factor from ``(YᵀY/n)^(-1/2)`` to standard deviations: the noise over the root of the number of
            samples that one repetition takes.
    """

    size: Array
    std: float


class Criterion(ABC):
    """A function of the information matrix ``A = YᵀY/n`` on the base columns.

    ``sharpness`` is the exponent p of the norms that stand for maxima: the larger, the closer to the maximum
    and the less smooth. At most ``log(n_base)/p`` is lost (Boyd and Vandenberghe 2004, section 3.1.5).

    Attributes:
        name: name in :data:`CRITERIA`.
        summary: one line for a person.
        weighted: whether rows are to be divided by the sensors' noise.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    weighted: ClassVar[bool]

    @abstractmethod
    def smooth(self, information: Array, scale: ParameterScale, sharpness: float) -> CriterionValue:
        """The criterion in logarithm, smoothed, with its derivative."""

    @abstractmethod
    def exact(self, information: Array, scale: ParameterScale) -> float:
        """The figure that a person reads."""


class ConditionNumber(Criterion):
    """Condition number of the base regressor, ``σ_max/σ_min`` (Gautier and Khalil 1992)."""

    name: ClassVar[str] = "condition"
    summary: ClassVar[str] = "condition number of the base regressor, unscaled"
    weighted: ClassVar[bool] = False

    def smooth(self, information: Array, scale: ParameterScale, sharpness: float) -> CriterionValue:
        """``½ log(‖λ‖_p ‖λ⁻¹‖_p)`` of the eigenvalues λ of A."""
        values, vectors = _eigen_decomposition(information)
        high = (values / values[-1]) ** sharpness
        low = (values[0] / values) ** sharpness
        value = 0.5 * (np.log(values[-1] / values[0]) + (np.log(high.sum()) + np.log(low.sum())) / sharpness)
        slope = 0.5 * (high / high.sum() - low / low.sum()) / values
        return CriterionValue(float(value), (vectors * slope) @ vectors.T)

    def exact(self, information: Array, scale: ParameterScale) -> float:
        """The condition number."""
        values = _eigen_decomposition(information)[0]
        return float(np.sqrt(values[-1] / values[0]))


class LogDeterminant(Criterion):
    """``-log det A`` by parameter: the volume of the confidence ellipsoid (D-optimality)."""

    name: ClassVar[str] = "log_det"
    summary: ClassVar[str] = "minus the log-determinant of the information matrix, by base parameter"
    weighted: ClassVar[bool] = True

    def smooth(self, information: Array, scale: ParameterScale, sharpness: float) -> CriterionValue:
        """``-log det A / n``; it needs no smoothing."""
        values, vectors = _eigen_decomposition(information)
        n = len(values)
        return CriterionValue(float(-np.log(values).mean()), -(vectors / (n * values)) @ vectors.T)

    def exact(self, information: Array, scale: ParameterScale) -> float:
        """``-log det A / n``."""
        return float(-np.log(_eigen_decomposition(information)[0]).mean())


class LargestRsd(Criterion):
    """Largest predicted relative standard deviation of a base parameter (Xu et al. 2020, eq. 7)."""

    name: ClassVar[str] = "largest_rsd"
    summary: ClassVar[str] = "largest predicted relative standard deviation of a base parameter [percent]"
    weighted: ClassVar[bool] = True

    def smooth(self, information: Array, scale: ParameterScale, sharpness: float) -> CriterionValue:
        """``½ log ‖diag(A⁻¹)/size²‖_p``."""
        values, vectors = _eigen_decomposition(information)
        inverse = (vectors / values) @ vectors.T
        ratio = np.diag(inverse) / scale.size**2
        top = ratio.max()
        power = (ratio / top) ** sharpness
        total = power.sum()
        value = 0.5 * (np.log(top) + np.log(total) / sharpness)
        slope = 0.5 * power / (total * ratio * scale.size**2)
        return CriterionValue(float(value), -(inverse * slope) @ inverse)

    def exact(self, information: Array, scale: ParameterScale) -> float:
        """Percent, of one repetition of the motion."""
        values, vectors = _eigen_decomposition(information)
        variance = ((vectors**2) / values).sum(axis=1)
        return float(100.0 * scale.std * (np.sqrt(variance) / scale.size).max())


CRITERIA: dict[str, type[Criterion]] = {
    criterion.name: criterion for criterion in (ConditionNumber, LogDeterminant, LargestRsd)
}


def make_criterion(name: str) -> Criterion:
    """The criterion of that name; raises UnknownNameError."""
    if name not in CRITERIA:
        raise UnknownNameError("criterion", name, sorted(CRITERIA))
    return CRITERIA[name]()


def _eigen_decomposition(information: Array) -> tuple[Array, Array]:
    """Eigenvalues, rising, none below rounding, and eigenvectors as columns."""
    values, vectors = np.linalg.eigh(information)
    return np.maximum(values, _FLOOR * values[-1]), vectors
