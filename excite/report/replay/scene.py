"""A robot as a page's replay has it: the tree of its joints, its bodies, its soles, the ground."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.report.replay.bodies import visible_bodies
from excite.report.replay.packed import pack_table, packed_indices
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
