"""Jerk-limited transfers from rest to rest (ruckig, Berscheid and Kröger 2021)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

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


def transfer(robot: Robot, start: Array, end: Array, rate_hz: float) -> Transfer:
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
    share, duration = _ramp(
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


def _ramp(
    velocity: float, acceleration: float, jerk: float
) -> tuple[Callable[[float], tuple[float, float, float]], float]:
    """From 0 to 1 at rest, as fast as the limits allow: position, velocity and acceleration at a time; duration."""
    import ruckig

    problem = ruckig.InputParameter(1)
    problem.current_position, problem.target_position = [0.0], [1.0]
    problem.max_velocity, problem.max_acceleration = [velocity], [acceleration]
    problem.max_jerk = [jerk]
    trajectory = ruckig.Trajectory(1)
    result = ruckig.Ruckig(1).calculate(problem, trajectory)
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise NoSolutionError(f"ruckig finds no transfer ({result})", remedy="check the limits")

    def state(time: float) -> tuple[float, float, float]:
        position, speed, rate = trajectory.at_time(float(time))
        return position[0], speed[0], rate[0]

    return state, float(trajectory.duration)
