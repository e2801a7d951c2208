"""Jerk-limited transfers from rest to rest (ruckig, Berscheid and Kröger 2021)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.errors import NoSolutionError
from excite.robot.robot import Array, Robot

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
    import ruckig

    problem = ruckig.InputParameter(robot.n_joints)
    problem.current_position, problem.target_position = list(start), list(end)
    problem.max_velocity = list(_SHARE * robot.limits.velocity)
    problem.max_acceleration = list(_SHARE * robot.limits.acceleration)
    problem.max_jerk = list(_SHARE * robot.limits.jerk)
    problem.synchronization = ruckig.Synchronization.Phase
    trajectory = _calculate(problem)
    samples = int(np.ceil(trajectory.duration * rate_hz - 1e-9)) + 1
    problem.minimum_duration = samples / rate_hz
    trajectory = _calculate(problem)
    time = np.arange(samples + 1) / rate_hz
    states = [trajectory.at_time(min(t, trajectory.duration)) for t in time]
    q, v, a = (np.array([state[k] for state in states]) for k in range(3))
    q[-1], v[-1], a[-1] = end, 0.0, 0.0
    return Transfer(time, q, v, a)


def _calculate(problem):
    import ruckig

    trajectory = ruckig.Trajectory(len(problem.current_position))
    result = ruckig.Ruckig(len(problem.current_position)).calculate(problem, trajectory)
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise NoSolutionError(f"ruckig finds no transfer ({result})", remedy="check the limits")
    return trajectory
