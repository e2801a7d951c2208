"""The uniform grid of samples that a controller runs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from excite.errors import InputError
from excite.motion.motion import Motion, interpolate_motion
from excite.reading.number import check_number
from excite.robot.robot import Robot

# From one sample a day to what no controller runs at [Hz].
_RATES_HZ = (1e-5, 1e6)
# Of one file: 0.8 GB in memory and twice that as text.
_MOST_NUMBERS = 100_000_000
_AT_REST = 1e-6  # [rad/s or m/s]; below it a motion that ends between two grid points may be held


def on_grid(motion: Motion, robot: Robot, rate_hz: float) -> Motion:
    """The motion from time zero, at exactly ``k / rate_hz`` [s].

    When the duration is no whole number of periods and the motion ends at rest, one more sample holds its
    last posture; when it ends moving, the grid stops at the last whole period.

    Args:
        motion: the motion.
        robot: its robot.
        rate_hz: samples per second.

    Returns:
        The motion on the grid, its q, v, a belonging together.

    Raises:
        InputError: ``rate_hz`` is not positive and finite, or gives fewer than two samples.
    """
    check_number(rate_hz, "rate_hz", *_RATES_HZ, "Hz", source="export")
    periods = motion.duration * rate_hz
    numbers = periods * (motion.q.shape[1] + motion.v.shape[1] + motion.a.shape[1])
    if numbers > _MOST_NUMBERS:
        raise InputError(
            f"{rate_hz:g} Hz gives {periods:.0f} samples of a motion of {motion.duration:.3f} s",
            source=motion.name,
            field="rate_hz",
            remedy=f"give at most {_MOST_NUMBERS / numbers * rate_hz:.0f} Hz",
        )
    whole = math.floor(periods + 1e-6)
    inside = np.arange(whole + 1) / rate_hz
    if len(inside) < 2:
        raise InputError(
            f"{rate_hz} Hz gives {len(inside)} sample of a motion of {motion.duration:.3f} s",
            source=motion.name,
            field="rate_hz",
            remedy=f"give at least {1.0 / motion.duration:.3f} Hz",
        )
    sampled = interpolate_motion(motion, robot, np.minimum(motion.time[0] + inside, motion.time[-1]))
    if periods - whole > 1e-6 and np.abs(motion.v[-1]).max() < _AT_REST:
        return replace(
            sampled,
            time=np.arange(whole + 2) / rate_hz,
            q=np.vstack([sampled.q, motion.q[-1]]),
            v=np.vstack([sampled.v, np.zeros(motion.v.shape[1])]),
            a=np.vstack([sampled.a, np.zeros(motion.a.shape[1])]),
            contacts={
                name: np.append(flags, motion.contacts[name][-1]) for name, flags in sampled.contacts.items()
            },
        )
    return replace(sampled, time=inside)
