"""Which mistakes a log's channels betray beside the nominal model, and the reading without them.

Nominal inertias are off by some tenths and friction is not known; a turned sign, an exchanged joint or a wrong clock
spoils the prediction by far more. Every mistake is undone in turn; the one that brings most is believed where it brings
much, and the search goes on from there: mistakes come in company.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.doctor.likely_bodies import FLOOR
from excite.doctor.mistakes.mistake import Correction, Mistake, Samples
from excite.doctor.reading import Reading

# What each change has to bring: half the logarithm of the residual's power, summed over the channels [nat]. In 22 logs
# of simulated arms with up to 18 effects each and 10 of real ones no change brings more than 0.10, or 0.14 where all
# joints move as one; the mistakes that were put into such logs bring from 0.5 to 16.
LEAST_GAIN = 0.35
# A channel that gains from a change has to be explained by it; more than this share of its power left is none.
_EXPLAINED = 0.5
_GAINS = 0.3
_MOST = 6
# Corrections of each mistake that are looked at closely.
_PROMISING = 3


S = TypeVar("S", bound=Samples)


@dataclass(frozen=True, eq=False)
class Misreading:
    """A mistake that was found.

    Attributes:
        correction: what undoes it.
        mistake: what it is.
        before: share of the channels' power that nothing explains as they were, geometric mean.
        after: the same with it undone.
        gain: sum over the channels of half the logarithm of what that brought [nat].
    """

    correction: Correction
    mistake: Mistake[Any]
    before: float
    after: float
    gain: float


def misreadings(
    samples: S, reading: Reading, mistakes: Sequence[Mistake[S]]
) -> tuple[Reading, tuple[Misreading, ...]]:
    """Undo mistakes one after the other, each time the one that brings most.

    Args:
        samples: samples of the log.
        reading: as the log states its channels.
        mistakes: those that are possible.

    Returns:
        The reading without them, and what was found.
    """
    found: list[Misreading] = []
    left = samples.judged(reading)
    while len(found) < _MOST:
        best: tuple[float, Correction, Mistake[S], Array] | None = None
        surprising: list[tuple[float, Correction, Mistake[S], Array]] = []
        # Where hardly anything is left there is nothing to gain.
        gainable = float((left[:-1] - 0.5 * np.log(FLOOR)).sum() + left[-1]) > LEAST_GAIN
        asked = mistakes if gainable else [mistake for mistake in mistakes if mistake.may_surprise]
        for mistake, correction in _promising(samples, reading, asked):
            then = samples.judged(correction.reading)
            merit = float((left - then).sum()) - LEAST_GAIN * correction.changes
            if (
                merit > 0.0
                and (best is None or merit > best[0])
                and _explains(samples, correction, left, then)
            ):
                best = (merit, correction, mistake, then)
            elif correction.surprise is not None:
                surprising.append((correction.surprise, correction, mistake, then))
        if best is None and surprising:
            best = max(surprising, key=lambda item: item[0])
        if best is None:
            break
        _, correction, mistake, then = best
        shares = [float(np.exp(2.0 * values[:-1].mean())) for values in (left, then)]
        found.append(Misreading(correction, mistake, shares[0], shares[1], float((left - then).sum())))
        reading, left = correction.reading, then
    return reading, tuple(found)


def _promising(
    samples: S, reading: Reading, mistakes: Sequence[Mistake[S]]
) -> list[tuple[Mistake[S], Correction]]:
    """The best corrections of each mistake by the nominal bodies alone, which are quick to ask."""
    start = float(samples.left(reading).sum())
    chosen = []
    for mistake in mistakes:
        gains = [
            (start - float(samples.left(item.reading).sum()), k, item)
            for k, item in enumerate(mistake.corrections(samples, reading))
        ]
        chosen += [(mistake, item) for _, _, item in sorted(gains, reverse=True)[:_PROMISING]]
    return chosen


def _explains(samples: Samples, correction: Correction, left: Array, then: Array) -> bool:
    """Whether channels that gain, and those that were changed, are explained then.

    Where no channel was changed and none gains, likelier bodies are all that speaks for the change; of torques that
    nothing explains they say nothing.
    """
    changed = [name in correction.places and name not in correction.along for name in samples.channels]
    return explained(left[:-1], then[:-1], np.array(changed))


def explained(before: Array, after: Array, changed: NDArray[np.bool_]) -> bool:
    """Whether channels are explained that gain by another reading or that it changes: by likely bodies, for the most.

    Args:
        before: ``(n,)`` half the logarithm of what is left of each channel, ``after``: by the other reading.
        changed: ``(n,)`` channels that the other reading changes.
    """
    good = after < 0.5 * np.log(_EXPLAINED)
    return bool(good[(before - after > _GAINS) | changed].all() and good.any())
