"""What errors of the fitted parameters leave of a gap, noise or not."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.floating.equations.band import in_band
from excite.diagnosis.floating.equations.problem import Problem
from excite.diagnosis.floating.search.refinement import Fitted, columns_of, explained_state


def left_by_parameters(
    problem: Problem,
    fitted: Fitted,
    scale: Array,
    samples: NDArray[np.bool_],
    rng: np.random.Generator,
    draws: int,
) -> Array:
    """Draws of the mean square, over channels in units of ``scale``, that a fit's parameters leave by their errors.

    Noise in the trials that were fitted moves the parameters by what their posterior covariance says
    (MacKay 1992, eq. 2.8); what that does to the residual of other trials is linear in it.

    Args:
        problem: the problem.
        fitted: a fit to its identification trials, with effects.
        scale: ``(6,)`` of the channels [N, N·m].
        samples: ``(n,)`` which samples are looked at.
        rng: of the draws.
        draws: how many.

    Returns:
        ``(draws,)``.
    """
    seen = problem.identification_only
    columns = np.hstack([seen.columns, columns_of(seen, fitted)])
    noise = (seen.rows(explained_state(seen, fitted)) ** 2).sum() / max(
        1, int((columns != 0.0).any(axis=1).sum())
    )
    precision = columns.T @ columns / max(1.0, float(noise)) + np.eye(columns.shape[1])
    turned = _in_samples(problem, fitted)
    n = len(turned)
    turned = in_band(problem.record, turned.reshape(n, -1)).reshape(turned.shape)[samples] / scale[:, None]
    flat = turned.reshape(-1, turned.shape[2])
    root = scipy.linalg.cholesky(precision, lower=True)
    spread = scipy.linalg.solve_triangular(root, flat.T @ flat / len(flat), lower=True)
    spread = scipy.linalg.solve_triangular(root, spread.T, lower=True)
    power = np.maximum(np.linalg.eigvalsh(spread), 0.0)
    return np.asarray(rng.chisquare(1.0, (draws, len(power))) @ power)


def _in_samples(problem: Problem, fitted: Fitted) -> Array:
    """``(n, 6, p + k)`` minus the derivative of the residual by the baseline's and the effects' scaled parameters."""
    parts = [explained_state(problem, fitted).regressor[:, :, problem.index] * problem.scales]
    state = problem.state(fitted.delta)
    for item, theta in zip(fitted.placed, fitted.theta, strict=True):
        effect, place = item.effect, item.location
        parts.append(effect.columns(state, place, theta) * effect.scales(state, place))
        state = effect.apply(state, place, theta)
    return np.concatenate(parts, axis=2)
