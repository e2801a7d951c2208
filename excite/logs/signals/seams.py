"""Angles that jump by whole turns, where an encoder passes the end of its count or a driver keeps within a turn."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array

# A jump leaves out what the joint moves in a row, below a tenth of a turn at 25 Hz and 15 rad/s; a joint that swings
# about the seam at 2 Hz jumps in every sixth row then.
_MOST, _SELDOM = 0.9, 0.17


def without_seams(values: Array, turn: float, *, within: bool = False) -> Array | None:
    """An angle that jumps by whole turns, going on; None where it is none.

    It jumps by whole turns now and then, and moves by little from row to row else, over the seam as well.

    Args:
        values: ``(n,)``; rows that are not finite stay.
        turn: what a turn is in their unit.
        within: whether it has to stay within a turn, and to cover it: of numbers that may be no angle.

    Returns:
        ``(n,)`` with whole turns added, none to the first.
    """
    known = np.isfinite(values)
    steps = np.diff(values[known])
    far = np.abs(steps) > 0.5 * turn
    if not far.any() or far.mean() > _SELDOM:
        return None
    if within and not _MOST * turn < np.ptp(values[known]) < 1.001 * turn:
        return None
    # A turn as it is written, in numbers of few digits, is none that can be taken off.
    turns = np.where(far, np.round(steps / turn), 0.0)
    over, fastest = np.abs(steps - turns * turn)[far], np.abs(steps[~far]).max(initial=0.0)
    # A clock that starts anew jumps by any length, and not by a turn less than a step.
    if not 0.0 < fastest < (1.0 - _MOST) * turn or (over > 2.0 * fastest).any():
        return None
    whole = values.copy()
    whole[known] -= turn * np.concatenate([[0.0], np.cumsum(turns)])
    return np.asarray(whole)
