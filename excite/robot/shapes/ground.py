"""The ground below a fixed base: never absent, so that no motion reaches through it unseen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.description import RobotDescription
from excite.robot.shapes.shape import Shape, shape_points
from excite.robot.sliding import is_prismatic

# Hulls of meshes stand out below a mounting plane by a hundredth of their size [m].
_FLANGE = 0.02
# Below all that a robot that hangs or is held up may reach [m].
_CLEAR = 0.1


def ground_is_assumed(description: RobotDescription) -> bool:
    """Whether a description with a fixed base leaves out where its ground is (null: there is none)."""
    return description.base == "fixed" and "table_height" not in description.collision.model_fields_set


def ground_height(model: pin.Model, shapes: Sequence[Shape], rest: Array, *, held_up: bool = False) -> float:
    """Height of the ground in the frame of a fixed base [m].

    It is the plane that the base is mounted on: that of its frame, or its lowest point where it stands on a pedestal.
    Of a robot that hangs, most of whose mass rests lower, and of one that is held up, it lies below all that the robot
    may reach.

    Args:
        model: the robot's, base fixed.
        shapes: its shapes.
        rest: its posture of rest ``(n_joints,)``.
        held_up: whether it has legs that shall swing free of the ground.
    """
    data = model.createData()
    centre = whole_centre(model, data, rest)
    low = lowest_points(shapes, data)
    base = low.get(0, 0.0)
    plane = base if base < -_FLANGE else 0.0
    if held_up:
        return min(plane, *low.values(), -robot_reach(model, shapes, from_base=True)) - _CLEAR
    if centre[2] >= plane - _FLANGE:
        return plane
    together = sum(float(np.linalg.norm(place.translation)) for place in list(model.jointPlacements)[1:])
    return min(plane, *low.values()) - together - _CLEAR


def robot_reach(model: pin.Model, shapes: Sequence[Shape], *, from_base: bool) -> float:
    """Length that no limb exceeds, whatever its joints do, to the farthest point of its shapes [m].

    Args:
        model: the robot's, base fixed.
        shapes: its shapes.
        from_base: measured from the base's frame, else from the limb's own first joint.
    """
    length = np.zeros(model.njoints)
    for joint in range(1, model.njoints):
        parent = model.parents[joint]
        if parent or from_base:
            length[joint] = length[parent] + np.linalg.norm(model.jointPlacements[joint].translation)
        if is_prismatic(model, model.idx_vs[joint]):
            at = model.joints[joint].idx_q
            length[joint] += max(abs(model.lowerPositionLimit[at]), abs(model.upperPositionLimit[at]))
    moving = [shape for shape in shapes if shape.joint or from_base]
    farthest = [np.linalg.norm(shape_points(shape), axis=1).max() + length[shape.joint] for shape in moving]
    return float(max(farthest, default=0.0))


def links_below(
    model: pin.Model, shapes: Sequence[Shape], rest: Array, ground: float, margin: float
) -> list[str]:
    """Links at or below the ground at rest, which are excepted from keeping ``margin`` [m] away from it."""
    data = model.createData()
    pin.forwardKinematics(model, data, rest)
    found: dict[str, None] = {}
    for shape in shapes:
        # What hangs on the base's own joint is never compared with the ground.
        if shape.joint == 0 or model.parents[shape.joint] == 0:
            continue
        if bottom(shape, data.oMi[shape.joint])[:, 2].min() < ground + margin:
            found[shape.link] = None
    return list(found)


def whole_centre(model: pin.Model, data: pin.Data, q: Array) -> Array:
    """Centre of mass, the root's included ``(3,)`` [m]; ``data`` then holds where the joints are."""
    own = model.inertias[0]
    moving = pin.centerOfMass(model, data, q)
    mass = float(sum(inertia.mass for inertia in list(model.inertias)[1:]))
    return np.asarray((mass * moving + own.mass * own.lever) / max(mass + own.mass, 1e-9))


def lowest_points(shapes: Sequence[Shape], data: pin.Data) -> dict[int, float]:
    """Height of the lowest point on each joint that has shapes, where ``data`` has the joints, by joint [m]."""
    found: dict[int, float] = {}
    for shape in shapes:
        z = float(bottom(shape, data.oMi[shape.joint])[:, 2].min())
        found[shape.joint] = min(found.get(shape.joint, np.inf), z)
    return found


def bottom(shape: Shape, joint: pin.SE3) -> Array:
    """Points of a shape's surface, its lowest among them, ``(n, 3)`` [m], the shape's joint being at ``joint``."""
    pose = joint * shape.placement
    if shape.vertices is not None:
        return np.asarray(shape.vertices @ pose.rotation.T + pose.translation)
    down = np.array([0.0, 0.0, -1.0])
    if shape.kind == "sphere":
        return np.asarray(pose.translation + shape.size[0] * down)[None]
    if shape.kind == "box":
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return np.asarray(0.5 * signs * np.array(shape.size) @ pose.rotation.T + pose.translation)
    radius, length = shape.size
    ends = [pose.act(np.array([0.0, 0.0, side * 0.5 * length])) for side in (-1.0, 1.0)]
    if shape.kind == "capsule":
        return np.array([end + radius * down for end in ends])
    axis = pose.rotation[:, 2]
    slope = down - (down @ axis) * axis
    if np.linalg.norm(slope) > 0.05:
        return np.array([end + radius * slope / np.linalg.norm(slope) for end in ends])
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    ring = radius * (
        np.outer(np.cos(angles), pose.rotation[:, 0]) + np.outer(np.sin(angles), pose.rotation[:, 1])
    )
    return np.vstack([end + ring for end in ends])
