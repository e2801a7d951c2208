"""Jerk-limited transfers from rest to rest (ruckig, Berscheid and Kröger 2021)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from excite.arrays import Array
from excite.errors import NoSolutionError
from excite.robot.robot import Robot

# Share of velocity, acceleration and jerk limits that a transfer uses.
_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Transfer:
    """Samples of a transfer of the actuated joints, both ends included.

    Attributes:
        time: ``(n,)`` [s], from 0.
        q: ``(n, n_joints)`` [rad or m].
        v: ``(n, n_joints)``.
        a: ``(n, n_joints)``.
    """

    time: Array
    q: Array
    v: Array
    a: Array


def plan_transfer(robot: Robot, start: Array, end: Array, rate_hz: float) -> Transfer:
    """Move the joints on a straight line from ``start`` to ``end``, at rest at both, jerk-limited.

    Args:
        robot: the robot.
        start: ``(n_joints,)`` [rad or m].
        end: ``(n_joints,)`` [rad or m].
        rate_hz: rate of the samples; the duration is a whole number of them [Hz].

    Raises:
        NoSolutionError: ruckig finds none.
    """
    way = end - start
    size = np.maximum(np.abs(way), 1e-9)
    limits = robot.limits
    share, duration = _unit_ramp(
        _SHARE * float((limits.velocity / size).min()),
        _SHARE * float((limits.acceleration / size).min()),
        _SHARE * float((limits.jerk / size).min()),
    )
    samples = max(1, int(np.ceil(duration * rate_hz - 1e-9)))
    time = np.arange(samples + 1) / rate_hz
    # Stretched to a whole number of samples.
    k = duration * rate_hz / samples
    states = np.array([share(t) for t in np.minimum(time * k, duration)])
    states[-1] = 1.0, 0.0, 0.0
    return Transfer(
        time=time,
        q=start + states[:, :1] * way,
        v=k * states[:, 1:2] * way,
        a=k**2 * states[:, 2:] * way,
    )


class _State(NamedTuple):
    """Share of a way, and its first two derivatives [1/s, 1/s²]."""

    position: float
    velocity: float
    acceleration: float


def _unit_ramp(velocity: float, acceleration: float, jerk: float) -> tuple[Callable[[float], _State], float]:
    """From 0 to 1 at rest, as fast as the limits allow: position, velocity and acceleration at a time; duration."""
    import ruckig

    # In units of time in which the jerk is one where ruckig fails on the limits as they are: of ways of some hundredths
    # of a radian they are thousands of the way per second cubed.
    for unit in (1.0, jerk ** (-1.0 / 3.0)):
        problem = ruckig.InputParameter(1)
        problem.current_position, problem.target_position = [0.0], [1.0]
        problem.max_velocity, problem.max_acceleration = [velocity * unit], [acceleration * unit**2]
        problem.max_jerk = [jerk * unit**3]
        trajectory = ruckig.Trajectory(1)
        try:
            result = ruckig.Ruckig(1).calculate(problem, trajectory)
        except ruckig.RuckigError:
            continue
        if result in (ruckig.Result.Working, ruckig.Result.Finished):
            return partial(_trajectory_state, trajectory, unit), unit * float(trajectory.duration)
    raise NoSolutionError("ruckig finds no transfer", remedy="check the limits")


def _trajectory_state(trajectory: Any, unit: float, time: float) -> _State:
    """The state of a trajectory whose time counts in ``unit`` [s]."""
    position, speed, rate = trajectory.at_time(float(time) / unit)
    return _State(position[0], speed[0] / unit, rate[0] / unit**2)
