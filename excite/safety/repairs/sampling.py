"""From path and time law to the samples of a motion, with transfers from and to rest (ruckig)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from importlib.metadata import version
from typing import Any, ClassVar, NamedTuple

import numpy as np

from excite.arrays import Array
from excite.errors import NoSolutionError
from excite.motion.generators.generator import rest_joints
from excite.motion.motion import Motion, MotionMetadata
from excite.robot.robot import Robot
from excite.safety.repairs.draft import Draft, Rejection, Repair, refused_by
from excite.safety.repairs.path import RunPath, run_path

_VERSIONS = ("excite", "pin", "placo", "toppra", "ruckig", "numpy", "scipy")
# A start this far from rest needs a transfer [rad or m].
_NEAR = 1e-9


class Sampling(Repair):
    """Samples the motion at the robot's rate, with a transfer from and to rest where it starts elsewhere."""

    name: ClassVar[str] = "sampling"

    @cached_property
    def _versions(self) -> dict[str, str]:
        return {package: version(package) for package in _VERSIONS}

    def repair(self, draft: Draft) -> Draft | Rejection:
        """A draft with a motion, or the rejection ``self_collision`` of a transfer."""
        if draft.path is None or draft.law is None:
            return draft.rejected("no_time_law", "path")
        rate = self.robot.description.sensors.rate_hz
        moved, candidate, closing = run_path(draft.path, draft.law, rate), draft.candidate, self.robot.closing
        contacts = {foot.name: candidate.supports(moved.s, foot.name) for foot in self.robot.feet}
        q, v, a = moved[2:]
        rest = rest_joints(self.robot)
        if not self.robot.floating and np.abs(q[0] - rest).max() > _NEAR:
            there, back = (
                plan_transfer(self.robot, start, end, rate) for start, end in ((rest, q[0]), (q[-1], rest))
            )
            for part in (there, back):
                ways = part.q if closing is None else closing.close_configurations(part.q)
                collision = self.probe.first(ways)
                if collision is not None:
                    return refused_by(draft, self.probe.closest(ways[collision:]), "transfer, {}")
            # One after the other, shared samples once.
            phases = zip(there[2:], moved[2:], back[2:], strict=True)
            q, v, a = (np.vstack([first[:-1], middle, last[1:]]) for first, middle, last in phases)
            if closing is not None:
                q, v, a = closing.complete_motion(q, v, a)
        motion = Motion(
            name=candidate.name,
            robot=self.robot.name,
            joint_names=self.robot.joint_names,
            time=np.arange(len(q)) / rate,
            q=q,
            v=v,
            a=a,
            contacts=contacts,
            metadata=MotionMetadata(
                generator=candidate.generator,
                seed=candidate.seed,
                targets=candidate.targets,
                robot_hash=self.robot.hash,
                versions=self._versions,
            ),
        )
        return replace(draft, motion=motion)


# Jerk-limited transfers from rest to rest (ruckig, Berscheid and Kröger 2021).

# Share of velocity, acceleration and jerk limits that a transfer uses.
_SHARE = 0.5


def plan_transfer(robot: Robot, start: Array, end: Array, rate_hz: float) -> RunPath:
    """Move the joints on a straight line from ``start`` to ``end``, at rest at both, jerk-limited.

    Args:
        robot: the robot.
        start: ``(n_joints,)`` [rad or m].
        end: ``(n_joints,)`` [rad or m].
        rate_hz: rate of the samples; the duration is a whole number of them [Hz].

    Returns:
        Samples of the joints; ``s`` is the share of the way.

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
    q, v, a = (states * [1.0, k, k**2]).T[:, :, None] * way
    return RunPath(time, states[:, 0], start + q, v, a)


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
