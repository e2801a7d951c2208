"""What the rows and the estimate, beside each other, leave in doubt."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from excite.arrays import Array
from excite.finding import Finding, list_names
from excite.identification.estimators.base import Estimate
from excite.identification.judgement.statistics import BaseStatistics
from excite.identification.regression import prior_std

_CONFLICT = 5.0
_MOST_NAMED = 4


def find_doubts(estimate: Estimate, statistics: BaseStatistics, spread: Array) -> tuple[Finding, ...]:
    """Directions that the data leave to the nominal model, conflict with plain least squares, bounds reached.

    Args:
        estimate: the estimate.
        statistics: least-squares base parameters of the same rows and weights.
        spread: expected spread of each segment's mass about nominal, as share of it, ``(n_segments,)``.
    """
    return (
        *_unexcited(estimate, statistics, spread),
        *_conflict(estimate, statistics),
        *_bounds(estimate),
    )


def _unexcited(estimate: Estimate, statistics: BaseStatistics, spread: Array) -> list[Finding]:
    """Directions of base parameters in which the data know less than the nominal model.

    Generalised eigenvalues of the estimate's covariance against that of parameters scattered about the
    nominal ones; above one, what is measured there is mostly noise.
    """
    matrix = statistics.base.matrix * prior_std(estimate.regression.problem, spread)
    prior = matrix @ matrix.T
    size = np.sqrt(np.diag(prior))
    if not (size > 0.0).all():
        return []
    scaled = np.outer(size, size)
    # Base parameters can be nearly the same combination; a small ridge keeps the pencil definite.
    expected = prior / scaled + 1e-9 * np.eye(len(size))
    ratios, directions = eigh(statistics.covariance / scaled, expected)
    blind = ratios > 1.0
    if not blind.any():
        return []
    weight = ((expected @ directions[:, blind]) ** 2).sum(axis=1)
    labels = statistics.base.labels
    names = tuple(labels[i] for i in np.argsort(-weight, kind="stable")[:_MOST_NAMED])
    text = (
        f"in {int(blind.sum())} of {len(ratios)} directions the data say less than the nominal model; what is "
        f"identified there is the model's or noise, most in {list_names(names)}: excite these joints more"
    )
    worst = float(np.sqrt(ratios.max()))
    return [Finding("unexcited", text, {"directions": float(blind.sum()), "worst_ratio": worst}, names)]


def _conflict(estimate: Estimate, statistics: BaseStatistics) -> list[Finding]:
    """Base parameters that constraints or the nominal model have moved far beyond their own uncertainty."""
    values = statistics.base.values(estimate.parameters)
    distance = np.abs(values - statistics.estimate) / np.maximum(statistics.std, 1e-300)
    far = distance > _CONFLICT
    if not far.any():
        return []
    order = np.argsort(-distance, kind="stable")[: int(far.sum())]
    names = tuple(statistics.base.labels[i] for i in order)
    inertial = estimate.regression.problem.n_inertial
    in_bodies = any(statistics.base.independent[i] < inertial for i in order[:_MOST_NAMED])
    cause = (
        "the rows hold something that no rigid body does, or the torque scale is off"
        if in_bodies
        else "friction does not follow the terms that were fitted (it may fall with speed, or differ by direction)"
    )
    text = (
        f"{estimate.method} and plain least squares differ by up to {distance.max():.0f} standard deviations "
        f"in {list_names(names, _MOST_NAMED)}: {cause}"
    )
    return [Finding("conflict", text, {"standard_deviations": float(distance.max())}, names)]


def _bounds(estimate: Estimate) -> list[Finding]:
    if not estimate.active:
        return []
    many = "1 constraint holds" if len(estimate.active) == 1 else f"{len(estimate.active)} constraints hold"
    text = f"{many} with equality, beyond which the data would go: {list_names(estimate.active, _MOST_NAMED)}"
    return [Finding("at_bound", text, {"constraints": float(len(estimate.active))}, estimate.active)]
