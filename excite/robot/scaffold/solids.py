"""Boxes in place of geometry that a model lacks: those whose mass, spread evenly, has the links' inertia.

No link is taken to be longer than its joints say: inertia that was made up, 1 kg·m² for any link, would fill the room.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.links import link_placement
from excite.robot.robot import Robot

# Thinner boxes than links of robots are come of inertia that was made up [m].
_THINNEST = 0.01
# Width of arms and legs by their length: a person's forearm has 0.3, a UR5's links 0.2 … 0.3.
_SLENDER = 0.3


def box_shapes(robot: Robot) -> list[dict[str, Any]]:
    """Authored shapes as ``collision.shapes`` in ``robot.yaml``, one a segment with mass."""
    shapes = []
    for segment in robot.segments:
        if robot.model.inertias[segment.joint].mass <= 0.0:
            continue
        size, in_joint = _box(robot.model, segment.joint)
        _, placement = link_placement(robot.model, segment.link, robot.source, "collision.shapes")
        pose = placement.actInv(in_joint)
        shapes.append(
            {
                "link": segment.link,
                "kind": "box",
                "size": [round(float(x), 4) for x in size],
                "xyz": [round(float(x), 5) for x in pose.translation],
                "rpy": [round(float(x), 5) for x in pin.rpy.matrixToRpy(pose.rotation)],
            }
        )
    return shapes


def _box(model: pin.Model, joint: int) -> tuple[Array, pin.SE3]:
    """Sides of the box in place of a joint's link, and its pose in the joint's frame: that of its inertia, or, where
    that is longer than the link can be, a stick from its joint to its farthest end."""
    inertia = model.inertias[joint]
    ends = [np.array(model.jointPlacements[other].translation) for other in model.children[joint]]
    if not ends and model.parents[joint]:
        # About as long beyond its joint as its parent is, the way to its centre of mass.
        before = float(np.linalg.norm(model.jointPlacements[joint].translation))
        way = float(np.linalg.norm(inertia.lever))
        ends = [inertia.lever * min(2.0, before / way)] if way > 1e-6 else []
    longest = 2.0 * max(float(np.linalg.norm(inertia.lever - end)) for end in (np.zeros(3), *ends))
    moments, axes = np.linalg.eigh(inertia.inertia)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] = -axes[:, 0]
    squares = 6.0 * (moments.sum() - 2.0 * moments) / inertia.mass
    sides = np.sqrt(np.maximum(squares, 0.0))
    if sides.max() <= max(longest, _THINNEST):
        return np.maximum(sides, _THINNEST), pin.SE3(axes, inertia.lever)
    end = max(ends, key=lambda one: float(np.linalg.norm(one)), default=np.zeros(3))
    length = float(np.linalg.norm(end))
    if length < _THINNEST:
        return np.full(3, _THINNEST), pin.SE3(np.eye(3), inertia.lever)
    turn = pin.Quaternion.FromTwoVectors(np.array([1.0, 0.0, 0.0]), end / length).matrix()
    return np.maximum([length, _SLENDER * length, _SLENDER * length], _THINNEST), pin.SE3(turn, 0.5 * end)
