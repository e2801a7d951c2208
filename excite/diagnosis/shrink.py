"""How far the gap shrinks, and how sure that is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.diagnosis.gap import ChannelGap, Gap, share_closed
from excite.diagnosis.samples import ArmSamples
from excite.diagnosis.units import force_unit
from excite.robot.robot import Array

_BLOCK_S = 1.0
_DRAWS = 500


def gap_of(
    samples: ArmSamples, before: Array, after: Array, floor: Array, scale: Array, rng: np.random.Generator
) -> Gap:
    """Gap on the validation trials before and after, with a 90 % interval by block bootstrap (Künsch 1989).

    Args:
        samples: the samples.
        before: ``(n_joints, n_rows)`` residual of the baseline [N·m].
        after: the same with the effects.
        floor: ``(n_joints,)`` noise floor [N·m].
        scale: ``(n_joints,)`` standard deviation of the torques in the identification trials [N·m].
        rng: random numbers of the bootstrap.

    Returns:
        The gap; where there are no validation trials, on the identification trials.
    """
    outside = ~samples.identification
    rows = outside if outside.any() else samples.identification
    length = max(1, round(_BLOCK_S * samples.bands.rate_hz))
    blocks = []
    for k in np.unique(samples.trial_of_row[rows]):
        index = np.flatnonzero(samples.trial_of_row == k)
        blocks += np.array_split(index, max(1, len(index) // length))
    old = np.array([(before[:, b] ** 2).mean(axis=1) for b in blocks])
    new = np.array([(after[:, b] ** 2).mean(axis=1) for b in blocks])
    floor = np.minimum(floor, np.sqrt(np.minimum(new.mean(axis=0), old.mean(axis=0))))
    total_floor = float(np.sqrt(np.mean(floor**2 / scale**2)))

    def totals(pick: NDArray[np.intp]) -> tuple[float, float]:
        b, a = (float(np.sqrt(np.mean(x[pick].mean(axis=0) / scale**2))) for x in (old, new))
        return b, a

    first, last = totals(np.arange(len(blocks)))
    draws = []
    for _ in range(_DRAWS if before is not after else 0):
        b, a = totals(rng.integers(0, len(blocks), len(blocks)))
        draws.append(share_closed(b, a, min(total_floor, a)))
    interval = (float(np.quantile(draws, 0.05)), float(np.quantile(draws, 0.95))) if draws else None
    channels = {
        name: ChannelGap(
            float(np.sqrt(old[:, j].mean())),
            float(np.sqrt(new[:, j].mean())),
            float(floor[j]),
            force_unit(samples.robot, name),
        )
        for j, name in enumerate(samples.joints)
    }
    return Gap(first, last, total_floor, share_closed(first, last, total_floor), channels, interval)
