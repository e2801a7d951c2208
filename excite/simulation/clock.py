"""Steps of the physics and of the sensors in a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.motion.motion import Motion
from excite.simulation.virtual_robot import VirtualRobot


@dataclass(frozen=True, eq=False)
class Clock:
    """Steps of the physics and of the sensors.

    Attributes:
        step: [s]
        per_sample: steps between two sensor samples.
        settle: steps before the motion starts, a multiple of ``per_sample``.
        samples: number of sensor samples.
    """

    step: float
    per_sample: int
    settle: int
    samples: int


def clock_of(virtual: VirtualRobot, motion: Motion, settle_s: float) -> Clock:
    """The clock of a run of a motion, which settles for ``settle_s`` [s] first."""
    period = 1.0 / virtual.robot.description.sensors.rate_hz
    per_sample = _steps_a_sample(virtual, period)
    samples = int(np.floor(motion.duration / period + 1e-9)) + 1
    settle = round(settle_s / period) * per_sample
    return Clock(period / per_sample, per_sample, settle, samples)


def step_of(virtual: VirtualRobot) -> float:
    """Step of the physics in any run of a virtual robot [s]."""
    period = 1.0 / virtual.robot.description.sensors.rate_hz
    return period / _steps_a_sample(virtual, period)


def _steps_a_sample(virtual: VirtualRobot, period: float) -> int:
    return max(1, int(np.ceil(period / virtual.world.timestep - 1e-9)))
