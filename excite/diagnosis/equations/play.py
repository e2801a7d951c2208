"""Dry friction behind play: how much of it a drive carries."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.lazy_kernel import LazyKernel


def behind_play(way: Array, starts: NDArray[np.bool_], width: float, breakaway: float) -> Array:
    """Share of the dry friction behind play and a spring that is carried, ``(n,)``, −1…1.

    A stop operator with a dead band: the drive's way ``z`` against what rubs follows the motion between the ends
    ``±(width/2 + breakaway)``, where friction slips, and ``sign(z) min(max(|z| − width/2, 0)/breakaway, 1)`` is carried
    (Nordin, Gutman 2002, section 2; without play the operator of Prandtl and Ishlinskii).

    Args:
        way: ``(n,)`` motion since the sample before [rad or m].
        starts: ``(n,)`` which samples are the first of a trial, where ``z`` is in the middle.
        width: of the play [rad or m].
        breakaway: way over which friction builds up once the play is used up [rad or m].
    """
    return np.asarray(_carried(np.ascontiguousarray(way), starts, 0.5 * width, breakaway))


@LazyKernel
def _carried(way, starts, half, breakaway):  # pragma: no cover - compiled
    out = np.empty(len(way))
    z, end = 0.0, half + breakaway
    for i in range(len(way)):
        z = 0.0 if starts[i] else min(max(z + way[i], -end), end)
        carried = max(abs(z) - half, 0.0) / breakaway
        out[i] = carried if z > 0.0 else -carried
    return out
