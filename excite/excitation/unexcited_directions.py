"""What motions do not excite: weak directions in the space of the base parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.excitation.conditioning import (
    RANK_TOLERANCE,
    Conditioning,
    MotionFactor,
    base_singular_values,
    stack_factors,
)
from excite.regressor.base_parameters import BaseParameters, describe_combination

# What motions do not excite: weak directions in the space of the base parameters.


@dataclass(frozen=True, eq=False)
class WeakDirection:
    """A combination of base parameters that shows little in what the sensors measure.

    Attributes:
        singular_value: the norm of the measured rows that a unit step along it makes [SI].
        weights: ``(n_base,)``, of unit norm, the largest positive.
        text: the combination in words, small terms left out.
    """

    singular_value: float
    weights: Array
    text: str


@dataclass(frozen=True)
class UnexcitedParameter:
    """A base parameter that motions leave undetermined.

    Attributes:
        index: among the base parameters.
        label: name of its own column.
        expression: the whole combination.
        share: how much of it lies in undetermined directions, up to 1.
    """

    index: int
    label: str
    expression: str
    share: float


@dataclass(frozen=True)
class Gain:
    """What one more motion adds to those at hand.

    Attributes:
        motion: its name.
        rank: rank that it adds on the base columns.
        log_det: what it adds to the log-determinant; None while rank is lacking before it.
        full: condition number with it, infinite while rank is lacking.
    """

    motion: str
    rank: int
    log_det: float | None
    full: float


def weak_directions(
    factor: MotionFactor, base: BaseParameters, k: int = 5, least_weight: float = 0.1
) -> tuple[WeakDirection, ...]:
    """The ``k`` directions with the smallest singular values of the base columns, weakest first.

    Args:
        factor: of the motions.
        base: structural base parameters.
        k: how many.
        least_weight: terms with smaller weights are left out of the text.

    Raises:
        InputError: base parameters of other columns.
    """
    values, vectors = _decompose_factor(factor, base)
    directions = []
    for value, vector in list(zip(values, vectors, strict=True))[::-1][:k]:
        # A singular vector's sign is arbitrary: make its largest weight positive.
        vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
        text = describe_combination(
            np.where(np.abs(vector) < least_weight, 0.0, vector), base.labels, digits=2
        )
        directions.append(WeakDirection(float(value), vector, text))
    return tuple(directions)


def unexcited_parameters(
    conditioning: Conditioning, tol: float = 1e-6, share: float = 0.25
) -> tuple[UnexcitedParameter, ...]:
    """Base parameters that the motions do not determine.

    Args:
        conditioning: of the motions.
        tol: directions with a singular value below this share of the largest count as undetermined. Motions
            that keep the feet on the ground do so only to the tolerance of a solver, so that exact zeros are
            rare.
        share: a parameter is reported when more than this share of its unit vector's square lies in them.
    """
    base = conditioning.base
    values, vectors = _decompose_factor(conditioning.factor, base)
    shares = (vectors[values < tol * values[0]] ** 2).sum(axis=0)
    return tuple(
        UnexcitedParameter(int(i), base.labels[i], base.expressions[i], float(shares[i]))
        for i in np.flatnonzero(shares > share)
    )


def motion_gains(current: Conditioning, factors: Sequence[MotionFactor]) -> tuple[Gain, ...]:
    """What each of several motions would add to those at hand, in the order handed over.

    Args:
        current: of the motions at hand.
        factors: one a candidate.

    Raises:
        InputError: factors that do not fit together.
    """
    found = []
    for factor in factors:
        values = base_singular_values(stack_factors([current.factor, factor]), current.base)
        rank = int((values > RANK_TOLERANCE * values[0]).sum())
        complete, before = rank == current.base.rank, np.isfinite(current.log_det)
        found.append(
            Gain(
                motion=" + ".join(factor.motions),
                rank=rank - current.rank,
                log_det=float(2.0 * np.log(values).sum() - current.log_det) if complete and before else None,
                full=float(values[0] / values[-1]) if complete else np.inf,
            )
        )
    return tuple(found)


def _decompose_factor(factor: MotionFactor, base: BaseParameters) -> tuple[Array, Array]:
    """Singular values ``(n_base,)``, falling, and right singular vectors as rows ``(n_base, n_base)``."""
    values = base_singular_values(factor, base)
    vectors = np.linalg.svd(factor.matrix[:, base.independent], full_matrices=True)[2]
    return values, vectors
