"""Collision shapes of a robot in a MuJoCo model that is asked which of them meet."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_model, collision_shapes
from excite.robot.shapes.ground import links_below
from excite.robot.shapes.shape import Shape
from excite.simulation.coordinates import body_name

if TYPE_CHECKING:
    import mujoco

GROUND = "ground"
# What MuJoCo calls the body that nothing moves.
WORLD = "world"


def watch_shapes(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add collision shapes, and make their pairs that must not meet, also with the ground, the only ones that do.

    What rests on soles or nearer to the ground than bodies keep from each other, such as the part between an ankle's
    two joints, is no further from it when the robot stands.
    """
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    shapes = collision_shapes(robot)
    for shape in shapes:
        carrier = body_name(robot.segments[shape.joint - 1].link) if shape.joint else WORLD
        _add_shape(spec, spec.body(carrier), shape)
    for pair in collision_model(robot).collisionPairs:
        _watch_contacts(spec, shapes[pair.first].name, shapes[pair.second].name)
    if not robot.feet:
        return
    soles = {foot.joint for foot in robot.feet}
    low = links_below(robot.model, shapes, robot.rest, 0.0, robot.description.collision.margin)
    for shape in shapes:
        if shape.joint not in soles and shape.link not in low:
            _watch_contacts(spec, GROUND, shape.name)


def _watch_contacts(spec: mujoco.MjSpec, first: str, second: str) -> None:
    """Find contacts of two shapes as soon as they overlap."""
    spec.add_pair(geomname1=first, geomname2=second)


def _add_shape(spec: mujoco.MjSpec, body: mujoco.MjsBody, shape: Shape) -> None:
    import mujoco

    kinds = {
        "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
        "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
        "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
        "box": mujoco.mjtGeom.mjGEOM_BOX,
        "convex": mujoco.mjtGeom.mjGEOM_MESH,
    }
    geom = body.add_geom(
        name=shape.name,
        type=kinds[shape.kind],
        pos=shape.placement.translation,
        quat=mujoco_quaternion(shape.placement.rotation),
        contype=0,
        conaffinity=0,
    )
    if shape.vertices is not None and shape.faces is not None:
        mesh = spec.add_mesh(name=shape.name)
        mesh.uservert = np.ravel(shape.vertices)
        mesh.userface = np.ravel(shape.faces)
        geom.meshname = shape.name
    elif shape.kind == "box":
        geom.size = [0.5 * length for length in shape.size]
    elif shape.kind == "sphere":
        geom.size = [shape.size[0], 0.0, 0.0]
    else:
        geom.size = [shape.size[0], 0.5 * shape.size[1], 0.0]


def mujoco_quaternion(rotation: Array) -> Array:
    """Quaternion of a rotation ``(3, 3)`` in MuJoCo's order, ``(4,)``."""
    x, y, z, w = pin.Quaternion(rotation).normalized().coeffs()
    return np.array([w, x, y, z])
