"""A trial of a record as a page's replay has it: the robot as it was measured, and a ghost beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.logs.columns import BASE_POSE
from excite.report.replay.packed import pack_table
from excite.report.replay.tracks import FRAMES_HZ, joint_bounds
from excite.robot.joint_values import Limits
from excite.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class TrialFrames:
    """A trial at :data:`~excite.report.replay.tracks.FRAMES_HZ`.

    Attributes:
        name: of the trial.
        time: ``(n,)`` [s], from zero.
        q: measured configurations, ``(n, nq)``; joints that were not recorded rest.
        ghost: what the other robot is, and its configurations, ``(n, nq)``; None without one.
        limits: of the joints.
    """

    name: str
    time: Array
    q: Array
    ghost: tuple[str, Array] | None
    limits: Limits

    def to_json(self) -> dict[str, Any]:
        """Of the content of :meth:`~excite.report.replay.tracks.Tracks.to_json` what a record tells."""
        first = self.q.shape[1] - len(self.limits.position_lower)
        signal: dict[str, Any] = {"title": "position", "unit": "rad", "from": first, "label": "measured"}
        signal["limits"] = joint_bounds(self.limits.position_lower, self.limits.position_upper)
        content: dict[str, Any] = {
            "name": self.name,
            "time": pack_table(self.time),
            "q": pack_table(self.q),
            "label": "measured",
            "signals": [signal],
        }
        if self.ghost is not None:
            label, q = self.ghost
            content["ghost"] = {"label": label, "q": pack_table(q)}
            if (q[:, first:] != self.q[:, first:]).any():
                # Where the base alone departs, joints have nothing to compare.
                signal |= {"other": pack_table(q[:, first:]), "otherLabel": label}
        return content


def trial_frames(
    robot: Robot,
    name: str,
    time: Array,
    measured: Array,
    joints: tuple[str, ...],
    *,
    base: Array | None = None,
    ghost: tuple[str, Array] | None = None,
) -> TrialFrames:
    """What is to be seen of a trial.

    Args:
        robot: the robot.
        name: of the trial.
        time: ``(n,)`` [s], increasing.
        measured: positions, ``(n, n_joints)`` [rad or m].
        joints: of the columns; those of :data:`~excite.logs.columns.BASE_POSE` are a free base's pose.
        base: poses of a free base, ``(n, 7)``: x y z qx qy qz qw; None where they were not recorded, or are columns.
        ghost: what the other robot is, and its positions, ``(n, n_joints)``.
    """
    frames = np.linspace(time[0], time[-1], max(2, round(float(time[-1] - time[0]) * FRAMES_HZ) + 1))
    here = np.tile(robot.rest, (len(frames), 1))
    if base is not None and robot.floating:
        here[:, :7] = base[np.searchsorted(time, frames).clip(0, len(time) - 1)]
    here = _posed_configurations(robot, here, joints, frames, time, measured)
    other = None
    if ghost is not None:
        other = (ghost[0], _posed_configurations(robot, here, joints, frames, time, ghost[1]))
    return TrialFrames(name, frames - frames[0], here, other, robot.limits)


def _posed_configurations(
    robot: Robot, q: Array, joints: tuple[str, ...], frames: Array, time: Array, positions: Array
) -> Array:
    """Configurations ``(n_frames, nq)`` with the joints, and the base where it is among them, at their positions."""
    found = q.copy()
    turning = [k for k, joint in enumerate(joints) if joint not in BASE_POSE]
    columns = [robot.n_base_q + robot.joint_index(joints[k]) for k in turning]
    found[:, columns] = _values_at(frames, time, positions[:, turning])
    if len(turning) < len(joints) and robot.floating:
        pose = [joints.index(name) for name in BASE_POSE]
        found[:, :7] = positions[np.searchsorted(time, frames).clip(0, len(time) - 1)][:, pose]
    return found


def _values_at(frames: Array, time: Array, values: Array) -> Array:
    return np.column_stack([np.interp(frames, time, column) for column in values.T])
