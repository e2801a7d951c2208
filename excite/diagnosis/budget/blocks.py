"""Stretches of a record that are left out together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.diagnosis.budget.thresholds import THRESHOLDS
from excite.diagnosis.equations.samples import ArmSamples

# Fewer blocks tell no spread; more cost time and tell no more.
_FEWEST, _MOST = 8, 16


def blocks_of(samples: ArmSamples, *, identification: bool) -> NDArray[np.int64]:
    """Number of each row's block, ``(n_rows,)``; −1 where the row is of the other trials.

    A trial that repeats another shares its blocks: what is left out must not be known from its repeat.

    Args:
        samples: the samples.
        identification: whether to cut the trials that are fitted, or those that judge.
    """
    own = [k for k, t in enumerate(samples.trials) if t.identification is identification]
    first = {samples.trials[k].name: k for k in own}
    leader = {k: first.get(samples.trials[k].repeats or "", k) for k in own}
    lengths = {k: len(samples.trials[k].rows) for k in own if leader[k] == k}
    total = sum(lengths.values())
    size = max(total / _MOST, THRESHOLDS.block_s * samples.bands.rate_hz)
    size = min(size, total / _FEWEST) if total else 1.0
    block = np.full(len(samples.trial_of_row), -1, dtype=np.int64)
    begun: dict[int, tuple[int, int]] = {}
    count = 0
    for k, length in lengths.items():
        pieces = max(1, round(length / max(size, 1.0)))
        begun[k] = (count, pieces)
        count += pieces
    for k in own:
        start, pieces = begun[leader[k]]
        rows = np.flatnonzero(samples.trial_of_row == k)
        length = lengths[leader[k]]
        block[rows] = start + np.minimum(np.arange(len(rows)) * pieces // max(length, 1), pieces - 1)
    return block
