"""Links whose geometry is missing, and boxes in its place.

A box has the mass spread evenly that has the link's inertia, and is no smaller than such a body at the density of
robots. No link is taken to be longer than its joints say: inertia that was made up, 1 kg·m² for any link, would fill
the room.
"""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress
from functools import lru_cache
from typing import Any
from xml.etree.ElementTree import Element

import coal
import numpy as np
import pinocchio as pin
from defusedxml.ElementTree import fromstring

from excite.arrays import Array
from excite.errors import RobotError
from excite.finding import first_names
from excite.robot.links import link_placement
from excite.robot.robot import Robot
from excite.robot.shapes.collision import SURROUNDINGS, collision_shapes, mesh_points
from excite.robot.shapes.link_shapes import link_shapes, links_by_kind
from excite.robot.shapes.shape import Shape, coal_geometry
from excite.robot.urdf.inertia import Inertial, read_inertial
from excite.robot.urdf.numbers import read_origin
from excite.robot.urdf.tree import MOVING, link_at

DENSITY = 1000.0
"""Mass per volume of convex hulls about links [kg/m³].

Of 75 published robots with both the median is 815, nine tenths lie between 370 and 2000; of arms (UR10, Panda, FR3,
Jaco, xArm, KR 16 …) between 680 and 1800, UR10 and Panda at 970.
"""
# Thinner boxes than links of robots are come of inertia that was made up [m].
_THINNEST = 0.01
# Width of arms and legs by their length: a person's forearm has 0.3, a UR5's links 0.2 … 0.3.
_SLENDER = 0.3


def links_lacking_geometry(robot: Robot) -> tuple[str, ...]:
    """Links with ``collision`` or ``visual`` elements of which one cannot be built: its file is missing or damaged."""
    links, shaped = fromstring(robot.urdf).findall("link"), set[str]()
    every = frozenset(link.get("name", "") for link in links)
    for kind, shown in links_by_kind(links, "either").items():
        points = mesh_points(shown, kind, every)
        for link in shown:
            with suppress(RobotError):
                shaped |= {shape.link for shape in link_shapes(robot, link, kind, points)}
    return tuple(name for link in links if (name := link.get("name", "")) not in shaped and _is_drawn(link))


def links_without_shape(robot: Robot) -> tuple[str, ...]:
    """Links that are bodies and that no shape stands for: nothing checks what they touch.

    A body has weight, or is drawn, or holds a joint that moves away from its own frame, as a base without
    ``<inertial>`` does. A shape stands for a link if it is the link's own, or if the same joint carries it and the
    link's centre of mass lies in it, as that of a rotor does in its housing; for one without weight, any of its body,
    unless it is drawn and holds a joint. What is lighter than the smallest stand-in has no weight.
    """
    shapes, found = _own_shapes(robot), list[str]()
    named, shaped = {shape.link for shape in shapes}, {shape.joint for shape in shapes}
    root = fromstring(robot.urdf)
    for link in root.findall("link"):
        name, inertial = link.get("name", ""), read_inertial(link, robot.source)
        if name in named:
            continue
        joint, placement = link_placement(robot.model, name, robot.source, "collision")
        if inertial is not None and inertial.mass >= DENSITY * _THINNEST**3:
            centre = np.asarray(placement.act(inertial.centre))
            bare = not any(shape.joint == joint and _contains_point(shape, centre) for shape in shapes)
        else:
            drawn, holds = _is_drawn(link), _holds_joint(root, name)
            bare = (drawn and holds) or (joint not in shaped and (drawn or holds))
        if bare:
            found.append(name)
    return tuple(found)


def _is_drawn(link: Element) -> bool:
    return any(link.find(kind) is not None for kind in ("collision", "visual"))


def _holds_joint(root: Element, name: str) -> bool:
    """Whether a link carries a joint that moves away from the link's own frame."""
    held = [joint for joint in root.findall("joint") if link_at(joint, "parent") == name]
    return any(
        float(np.linalg.norm(read_origin(joint).translation)) > _THINNEST
        for joint in held
        if joint.get("type") in MOVING
    )


@lru_cache(maxsize=4)
def shape_conditions(robot: Robot) -> tuple[str, ...]:
    """What has to hold of shapes that are not known, for a motion in which nothing touches to be free of collision."""
    block, found = robot.description.collision, list[str]()
    boxes = [shape.link for shape in block.shapes if shape.link in block.stand_ins]
    if boxes:
        found.append(f"boxes stand for the missing geometry of {first_names(boxes, 3)}")
    bare = links_without_shape(robot)
    if bare:
        found.append(f"nothing touches {first_names(bare, 3)}, for which no shape stands")
    return tuple(found)


def box_shapes(robot: Robot, links: Collection[str]) -> list[dict[str, Any]]:
    """Boxes in place of links, as ``collision.shapes`` in ``robot.yaml``.

    Left out are links without mass that are not drawn, or that hold no joint beside others of their body that have
    shapes.
    """
    root, boxes = fromstring(robot.urdf), list[dict[str, Any]]()
    shaped = {shape.joint for shape in _own_shapes(robot)}
    for link in root.findall("link"):
        name = link.get("name", "")
        if name not in links:
            continue
        inertial = read_inertial(link, robot.source)
        joint, _ = link_placement(robot.model, name, robot.source, "collision")
        if inertial is None and not (_is_drawn(link) and (_holds_joint(root, name) or joint not in shaped)):
            continue
        sides, pose = _find_link_box(root, name, inertial)
        if sides is not None:
            # Rounded up: no smaller than the body.
            size = [round(float(np.ceil(1e4 * x - 1e-6)) / 1e4, 4) for x in sides]
            place, turn = pose.translation, pin.rpy.matrixToRpy(pose.rotation)
            xyz, rpy = ([round(float(x), 5) for x in values] for values in (place, turn))
            boxes.append({"link": name, "kind": "box", "size": size, "xyz": xyz, "rpy": rpy})
    return boxes


def _own_shapes(robot: Robot) -> tuple[Shape, ...]:
    """Shapes of the robot's links, none where it has none."""
    block = robot.description.collision
    if block.geometry == "authored" and not block.shapes:
        return ()
    return tuple(shape for shape in collision_shapes(robot) if shape.link not in SURROUNDINGS)


def _contains_point(shape: Shape, point: Array) -> bool:
    """Whether a point ``(3,)`` in the frame of a shape's joint lies in it."""
    place = coal.Transform3s(shape.placement.rotation, shape.placement.translation)
    ball, at = coal.Sphere(1e-4), coal.Transform3s(np.eye(3), point)
    found = coal.CollisionResult()
    return bool(coal.collide(coal_geometry(shape), place, ball, at, coal.CollisionRequest(), found))


def _find_link_box(root: Element, name: str, inertial: Inertial | None) -> tuple[Array | None, pin.SE3]:
    """Sides of the box in place of a link, None where nothing says how large it is; and its pose in the link's frame.

    It is that of its inertia, or, where that is longer than the link can be, a stick from its joint to its end, or a
    box about its joint and all its ends; each is grown to the volume of its mass.
    """
    centre, mass = (np.zeros(3), 0.0) if inertial is None else (inertial.centre, inertial.mass)
    ends, volume = _link_ends(root, name, centre), mass / DENSITY
    if inertial is not None and mass > 0.0:
        longest = 2.0 * max(float(np.linalg.norm(centre - end)) for end in (np.zeros(3), *ends))
        moments, axes = np.linalg.eigh(inertial.moments)
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        sides = np.sqrt(np.maximum(6.0 * (moments.sum() - 2.0 * moments) / mass, 0.0))
        if sides.max() <= max(longest, _THINNEST):
            return _grow_box(np.maximum(sides, _THINNEST), volume), pin.SE3(axes, centre)
    length = max((float(np.linalg.norm(end)) for end in ends), default=0.0)
    if length < _THINNEST:
        side = max(_THINNEST, float(np.cbrt(volume)))
        return np.full(3, side) if mass > 0.0 else None, pin.SE3(np.eye(3), centre)
    if len(ends) > 1:
        corners = np.array([np.zeros(3), *ends])
        low, high = corners.min(axis=0), corners.max(axis=0)
        sides = np.maximum(high - low, _SLENDER * length)
        return _grow_box(sides, volume), pin.SE3(np.eye(3), 0.5 * (low + high))
    turn = pin.Quaternion.FromTwoVectors(np.array([1.0, 0.0, 0.0]), ends[0] / length).matrix()
    width = max(_SLENDER * length, float(np.sqrt(volume / length)), _THINNEST)
    return np.array([length, width, width]), pin.SE3(turn, 0.5 * ends[0])


def _grow_box(sides: Array, volume: float) -> Array:
    return sides * max(1.0, float(np.cbrt(volume / sides.prod())))


def _link_ends(root: Element, name: str, centre: Array) -> list[Array]:
    """Where a link ends, in its frame: at the joints that it carries, those that move if any do, each ``(3,)`` [m].

    One that carries none is taken to go on beyond its centre of mass about as far as its parent is long.
    """
    joints = root.findall("joint")
    carried = [joint for joint in joints if link_at(joint, "parent") == name]
    moving = [joint for joint in carried if joint.get("type") in MOVING]
    ends = [np.asarray(read_origin(joint).translation) for joint in moving or carried]
    own = next((joint for joint in joints if link_at(joint, "child") == name), None)
    way = float(np.linalg.norm(centre))
    if not ends and own is not None and way > 1e-6:
        before = float(np.linalg.norm(read_origin(own).translation))
        ends = [centre * min(2.0, before / way)]
    return ends
