"""Where a joint may stick: dry friction is then whatever holds it, and the joint's equation says nothing.

A joint whose drive is too weak for its friction stands (Karnopp 1985), for tenths of a second where motion is slow. Its
torque goes from one side of the friction to the other then, on a way that no function of its motion tells, and the
filter of the rows would mix that into what comes before and after. So both sides of its equation are multiplied by next
to nothing where it may stand, before the filter: the equation holds there too, and weighs nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array, widen_flags

# Speed up to which a joint may stick, in those up to which it may as well stand, and for how long before and after it
# the filter of the kinematics may hide that, in periods of its cut-off. Of six records of simulated arms that stick
# (MuJoCo's frictionloss made hard, fast and slow motion) rigid bodies, viscous and dry friction leave .16 times as much
# with it as without; any speed from 1 to 4 and any time from .3 to 1 give the same within .01. Where friction creeps
# instead (two records, MuJoCo's frictionloss as it comes) a speed of 1, 2 and 4 leaves .30, .21 and .14 times as much,
# and takes 8, 12 and 17 % of the samples.
_SPEED, _AROUND = 2.0, 0.5
# Of a joint that is slow throughout, no more than what is slower than this share of its usual speed. On two records of
# 8 to 28 mrad/s .1, .25, .5 and 1 leave .30, .12, .15 and .49 times what is left without, no such limit .70.
_SLOW = 0.25
# What an equation weighs where its joint may stick. Nothing would leave .147 on those arms, .01 leaves .149, .05
# leaves .178; with nothing a joint that hardly slips would have no equation.
_STUCK = 0.01


def surely_slips(
    v: Array, starts: NDArray[np.bool_], still: float, rate_hz: float, cutoff_hz: float
) -> NDArray[np.bool_]:
    """Where a motor turns, as far as the filter of the kinematics tells, ``(n,)``; always if it never moves.

    Args:
        v: its velocity in all trials, ``(n,)`` [rad/s or m/s].
        starts: which samples are the first of a trial, ``(n,)``.
        still: speed up to which it may as well stand, same unit.
        rate_hz: of the samples.
        cutoff_hz: of the filter of the kinematics.
    """
    speed = np.abs(v)
    moving = speed[speed > still]
    if not len(moving):
        return np.ones(len(v), dtype=np.bool_)
    stuck = speed <= min(_SPEED * still, _SLOW * float(np.median(moving)))
    turned = (v[1:] * v[:-1] < 0.0) & ~starts[1:]
    stuck[1:] |= turned
    stuck[:-1] |= turned
    around = round(_AROUND * rate_hz / cutoff_hz)
    return np.concatenate(
        [~widen_flags(part, around) for part in np.split(stuck, np.flatnonzero(starts)[1:])]
    )


def counted(slips: NDArray[np.bool_]) -> Array:
    """What each joint's equation is multiplied by, ``(n, n_joints)``; its mean square is 1.

    One number where all motors on the joint surely slip, another, next to nothing, where one of them may stick; 1
    throughout for a joint that never surely slips.

    Args:
        slips: where they all do, likewise.
    """
    made = np.where(slips | ~slips.any(axis=0), 1.0, _STUCK)
    return np.asarray(made / np.sqrt((made**2).mean(axis=0)))
