"""How well parameters reproduce what was measured, channel by channel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.identification.problem import IdentificationProblem


@dataclass(frozen=True)
class ChannelFit:
    """Agreement of one channel, as in Table II of Jovic et al. (Humanoids 2015).

    Attributes:
        unit: unit of the root mean square errors, N or N·m.
        rmse: root mean square of measured minus predicted by the identified parameters.
        cc: Pearson's correlation of measured and predicted; None where one of them is constant.
        reference_rmse: the same for the nominal parameters.
        reference_cc: the same for the nominal parameters.
        std: standard deviation of the measured channel.
    """

    unit: str
    rmse: float
    cc: float | None
    reference_rmse: float
    reference_cc: float | None
    std: float


def channel_fits(
    problem: IdentificationProblem, parameters: Array, reference: Array
) -> dict[str, ChannelFit]:
    """Compare identified and reference parameters on every channel of a problem.

    Args:
        problem: rows of the trials to judge by.
        parameters: identified parameters ``(n_params,)``.
        reference: parameters to compare with ``(n_params,)``, usually the nominal ones.

    Returns:
        By channel name, in the problem's order; a channel without rows is left out.
    """
    predicted, nominal = problem.Y @ parameters, problem.Y @ reference
    fits = {}
    for name, unit in zip(problem.channel_names, problem.channel_units, strict=True):
        rows = problem.rows_of(name)
        if not rows.any():
            continue
        measured = problem.y[rows]
        fits[name] = ChannelFit(
            unit=unit,
            rmse=_rms(measured - predicted[rows]),
            cc=correlation(measured, predicted[rows]),
            reference_rmse=_rms(measured - nominal[rows]),
            reference_cc=correlation(measured, nominal[rows]),
            std=float(measured.std()),
        )
    return fits


def correlation(a: Array, b: Array) -> float | None:
    """Pearson's correlation coefficient of two signals ``(n,)``, None where one of them does not vary."""
    da, db = a - a.mean(), b - b.mean()
    scale = float(np.sqrt((da @ da) * (db @ db)))
    floor = 1e-12 * len(a) * max(float(np.abs(a).max()), 1e-30) * max(float(np.abs(b).max()), 1e-30)
    return None if scale <= floor else float(np.clip(da @ db / scale, -1.0, 1.0))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
