"""The lag of simulated motors: a filter before them, and one that the model has in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.simulator.rollout_drives import Drive, Window


@dataclass(frozen=True)
class MotorLag:
    """First-order filters of what motors are told.

    Attributes:
        before: time constant of the filter before the motors [s]; 0 without one.
        within: of the one that the model has [s]; None without one.
    """

    before: float
    within: float | None

    def share(self, step: float) -> float:
        """Share of what it is told that the filter before the motors follows in a step [s]."""
        return _share(step, self.before)

    def begun(self, window: Window, drive: Drive, delay: float) -> tuple[Array, Array]:
        """What the filters have come to at a window's start, before the motors and in them, ``(n_joints,)`` [N·m].

        Args:
            window: with the record before it; without that the motors have been told the same for long.
            drive: what tells them.
            delay: by which that is read later [s].
        """
        past = window.past
        if past is None or self.within is None:
            now = drive.answer(drive.offers(window.time[:1] + delay)[0], window.q, window.v)
            return now, now
        period = float(past.time[1] - past.time[0])
        first, second = _share(period, self.before), _share(period, self.within)
        one = two = drive.answer(drive.offers(past.time[:1] + delay)[0], past.q[0], past.v[0])
        # Half a period on: the command of an interval, not of its start.
        times = past.time[:-1] + 0.5 * period + delay
        for torque in drive.answer(drive.offers(times), past.q[:-1], past.v[:-1]):
            one = one + first * (torque - one)
            two = two + second * (one - two)
        return one, two


def _share(period: float, time_constant: float) -> float:
    """Share of a step that a first-order filter follows within a period."""
    return float(-np.expm1(-period / time_constant)) if time_constant > 0.0 else 1.0
