"""Torques that stand as shares of the joints' limits, as drives report them: percent or per mille of what is rated."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from excite.arrays import Array

# Nominal masses are off by some tenths, and a scale is no better than they are.
AS_STATED = 1.6


class Share(NamedTuple):
    """How much of a limit is called so many."""

    name: str
    whole: float


_SHARES = (Share("percent", 100.0), Share("per mille", 1000.0), Share("shares", 1.0))


def share_of_limits(gains: Array, limits: Array) -> Share | None:
    """What every joint's gain is if its torque is a share of its limit; None where that is not so.

    Where all limits are the same it is one factor, of which there are other causes.

    Args:
        gains: ``(n,)`` logged torque per N·m of the nominal model, positive.
        limits: ``(n,)`` largest torques [N·m or N].
    """
    if len(gains) < 2 or not np.isfinite(limits).all() or limits.max() < AS_STATED * limits.min():
        return None
    if (np.abs(np.log(gains)) < np.log(AS_STATED)).all():
        return None
    whole = gains * limits
    for share in _SHARES:
        if (np.abs(np.log(whole / share.whole)) < np.log(AS_STATED)).all():
            return share
    return None
