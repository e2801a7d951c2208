"""A robot as a page's replay has it: the tree of its joints, its bodies, its soles, the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.logs.columns import BASE_POSE
from excite.report.replay.bodies import visible_bodies
from excite.report.replay.tracks import FRAMES_HZ, joint_bounds, pack_table, packed_indices
from excite.robot.joint_values import Limits
from excite.robot.robot import Robot

# Corners are numbered with 16 bits, the last of which stands for what is not known.
_MOST_CORNERS = 65535


def robot_scene(robot: Robot) -> dict[str, Any]:
    """Everything of a robot that does not change in time, ready for JSON.

    Returns:
        ``joints``: of every model joint from 1 its ``parent`` (0 is the world), ``xyz`` and ``quat`` (x y z w) of its
        placement in the parent's frame, ``free`` for a free base, else ``turn`` and ``slide``, the axes [no unit] about
        which it turns and along which it slides, in its own frame, and ``name``. They stand as in the configuration.
        ``bodies``: see :class:`~excite.report.replay.bodies.Body`. ``feet``: ``name``, ``joint``, and corners of the
        ``sole`` in its frame. ``ground``: its height [m], null where there is none.
    """
    parts = [
        {
            "link": body.link,
            "joint": body.joint,
            "corners": pack_table(body.corners),
            "triangles": packed_indices(body.triangles),
        }
        for body in visible_bodies(robot)
        if 0 < len(body.triangles) and len(body.corners) < _MOST_CORNERS
    ]
    feet = [
        {"name": foot.name, "joint": foot.joint, "sole": [_round_values(corner) for corner in foot.sole]}
        for foot in robot.feet
    ]
    table = robot.description.collision.table_height
    ground = 0.0 if robot.floating else table
    return {"joints": joint_tree(robot.model), "bodies": parts, "feet": feet, "ground": ground}


def joint_tree(model: pin.Model) -> list[dict[str, Any]]:
    """The part ``joints`` of :func:`robot_scene`: of joints with one coordinate, and a free base."""
    joints = []
    for index in range(1, model.njoints):
        placement = model.jointPlacements[index]
        joint: dict[str, Any] = {
            "name": str(model.names[index]),
            "parent": int(model.parents[index]),
            "xyz": _round_values(placement.translation),
            "quat": _round_values(pin.Quaternion(placement.rotation).coeffs()),
        }
        if model.joints[index].nq == 1:
            slide, turn = _joint_axes(model, index)
            joint |= {"turn": _round_values(turn), "slide": _round_values(slide)}
        else:
            joint["free"] = True
        joints.append(joint)
    return joints


def _joint_axes(model: pin.Model, index: int) -> tuple[Array, Array]:
    """Along which a joint of one coordinate slides and about which it turns, in its own frame, ``(3,)`` each."""
    data = model.createData()
    jacobian = pin.computeJointJacobian(model, data, pin.neutral(model), index)
    column = np.asarray(jacobian).reshape(6, model.nv)[:, model.idx_vs[index]]
    return column[:3], column[3:]


def _round_values(values: Array) -> list[float]:
    return [round(float(value), 7) + 0.0 for value in values]


# A trial of a record as a page's replay has it: the robot as it was measured, and a ghost beside it.


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
