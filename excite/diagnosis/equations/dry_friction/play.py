"""Dry friction behind play: how much of it a drive carries."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.lazy_kernel import LazyKernel


def behind_play(way: Array, starts: NDArray[np.bool_], width: float, breakaway: float) -> Array:
    """Share of the dry friction behind play that is carried, ``(n,)``, −1…1.

    Bristles that bend (Dahl 1968), with play in series: where what they carry falls to zero, the drive goes through the
    play before they bend the other way.

    Args:
        way: ``(n,)`` motion since the sample before [rad or m].
        starts: ``(n,)`` which samples are the first of a trial, where the drive is in the middle of the play.
        width: of the play [rad or m].
        breakaway: deflection over which friction builds up once the play is used up [rad or m].
    """
    return np.asarray(_carried_friction(np.ascontiguousarray(way), starts, width, breakaway))


@LazyKernel
def _carried_friction(way, starts, width, breakaway):  # pragma: no cover - compiled
    out = np.empty(len(way))
    bent, at = 0.0, 0.5 * width
    for i in range(len(way)):
        step = way[i]
        if starts[i]:
            bent, at, step = 0.0, 0.5 * width, 0.0
        if bent != 0.0:
            after = (bent + step / breakaway) / (1.0 + abs(step) / breakaway)
            if after * bent > 0.0:
                bent, step = after, 0.0
            else:
                bent, step = 0.0, after * breakaway
        if bent == 0.0:
            at += step
            if at > width:
                bent, at = (at - width) / breakaway, width
            elif at < 0.0:
                bent, at = at / breakaway, 0.0
        out[i] = bent
    return out
