"""How far the gap shrinks, and how sure that is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.diagnosis.gap import ChannelGap, Gap, share_closed
from excite.diagnosis.samples import ArmSamples
from excite.diagnosis.units import force_unit
from excite.logs.signals.butterworth import noise_bandwidth
from excite.robot.robot import Array

_BLOCK_S = 1.0
_DRAWS = 500


def gap_of(
    samples: ArmSamples, before: Array, after: Array, floor: Array, scale: Array, rng: np.random.Generator
) -> Gap:
    """Gap on the validation trials before and after, with a 90 % interval by block bootstrap (Künsch 1989).

    Motions differ, so trials are drawn first and blocks within them (Davison, Hinkley 1997, section 3.8). The
    floor is measured too, on a trial that was repeated: each joint's power is drawn as a mean of as many
    independent squares as filtered white noise has in such a trial. Without both the interval is too short.

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
    blocks: list[NDArray[np.intp]] = []
    trial: list[NDArray[np.intp]] = []
    for k in np.unique(samples.trial_of_row[rows]):
        index = np.flatnonzero(samples.trial_of_row == k)
        parts = np.array_split(index, max(1, len(index) // length))
        trial.append(np.arange(len(blocks), len(blocks) + len(parts)))
        blocks += parts
    old = np.array([(before[:, b] ** 2).mean(axis=1) for b in blocks])
    new = np.array([(after[:, b] ** 2).mean(axis=1) for b in blocks])
    powers = floor**2 / scale**2
    floor = np.minimum(floor, np.sqrt(np.minimum(new.mean(axis=0), old.mean(axis=0))))

    def totals(pick: NDArray[np.intp]) -> tuple[float, float]:
        b, a = (float(np.sqrt(np.mean(x[pick].mean(axis=0) / scale**2))) for x in (old, new))
        return b, a

    first, last = totals(np.arange(len(blocks)))
    total_floor = min(float(np.sqrt(powers.mean())), first, last)
    share = share_closed(first, last, total_floor)
    freedom = _independent(samples)
    draws = []
    for _ in range(_DRAWS if before is not after else 0):
        chosen = [trial[k] for k in rng.integers(0, len(trial), len(trial))]
        b, a = totals(np.concatenate([rng.choice(own, len(own)) for own in chosen]))
        drawn = float(np.sqrt((powers * rng.chisquare(freedom, len(powers)) / freedom).mean()))
        draws.append(share_closed(b, a, min(drawn, b)))
    interval = None
    if draws:
        low, high = np.quantile(draws, (0.05, 0.95))
        interval = (min(float(low), share), max(float(high), share))
    channels = {
        name: ChannelGap(
            float(np.sqrt(old[:, j].mean())),
            float(np.sqrt(new[:, j].mean())),
            float(floor[j]),
            force_unit(samples.robot, name),
        )
        for j, name in enumerate(samples.joints)
    }
    return Gap(first, last, total_floor, share, channels, interval)


def _independent(samples: ArmSamples) -> float:
    """Independent samples that filtered noise has in the shortest trial, by which a repeat is limited."""
    bands = samples.bands
    seconds = min(len(trial.rows) for trial in samples.trials) / bands.rate_hz
    return max(1.0, noise_bandwidth(samples.rate_hz, bands.rows_hz) * samples.rate_hz * seconds)
