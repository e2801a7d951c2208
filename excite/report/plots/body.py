"""A robot in one posture as flat polygons and bones, seen from one side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import RobotError
from excite.robot.robot import Robot
from excite.robot.shapes.collision import TABLE, collision_shapes
from excite.robot.shapes.shape import Shape

_AZIMUTH, _ELEVATION = np.deg2rad(38.0), np.deg2rad(12.0)
_SHORTEST_BONE = 0.01
# Sides from which outlines are looked at for their outermost corners. A corner that is missed sticks out from the line
# between its neighbours by less than 0.7 % of what that is long, of a trunk less than a picture's dot.
_SIDES = 2.0 * np.pi * np.arange(256) / 256
_OUTWARDS = np.column_stack([np.cos(_SIDES), np.sin(_SIDES)])


@dataclass(frozen=True, eq=False)
class View:
    """A parallel projection.

    Attributes:
        right: world direction of the picture's x axis, ``(3,)``.
        up: world direction of its y axis, ``(3,)``.
        towards: world direction to the viewer, ``(3,)``.
    """

    right: Array
    up: Array
    towards: Array

    def flat(self, points: Array) -> Array:
        """Picture coordinates ``(n, 2)`` of world points ``(n, 3)`` [m]."""
        return np.column_stack([points @ self.right, points @ self.up])


def front_view() -> View:
    """From the front, a little to the robot's left and a little from above."""
    ca, sa, ce, se = np.cos(_AZIMUTH), np.sin(_AZIMUTH), np.cos(_ELEVATION), np.sin(_ELEVATION)
    return View(
        right=np.array([-sa, ca, 0.0]),
        up=np.array([-se * ca, -se * sa, ce]),
        towards=np.array([ce * ca, ce * sa, se]),
    )


@dataclass(frozen=True, eq=False)
class Picture:
    """What to draw of one posture, in picture coordinates relative to a point on the ground [m].

    Attributes:
        hulls: outlines of the links' shapes, far ones first, each ``(n, 2)``.
        bones: lines from joint to joint, each ``(2, 2)``.
        soles: outlines of the soles, each ``(n_corners, 2)``.
        support: outline of the support polygon, ``(n, 2)``; None where nothing stands on the ground.
        com: centre of mass projected on the ground, ``(2,)``; None for a fixed base.
        marked: outlines of the links that were to be marked, each ``(n, 2)``; they are no hulls then.
    """

    hulls: tuple[Array, ...]
    bones: tuple[Array, ...]
    soles: tuple[Array, ...]
    support: Array | None
    com: Array | None
    marked: tuple[Array, ...] = ()


def draw_posture(
    robot: Robot, q: Array, loaded: frozenset[str], view: View, marked: frozenset[str] = frozenset()
) -> Picture:
    """Draw a posture.

    Args:
        robot: the robot.
        q: configuration, ``(nq,)``.
        loaded: names of the feet that carry load.
        view: where it is seen from.
        marked: links to mark.
    """
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    origin = np.array([q[0], q[1], 0.0]) if robot.floating else np.zeros(3)

    def flat(points: Array) -> Array:
        return view.flat(np.asarray(points) - origin)

    soles = {
        foot.name: np.array([data.oMi[foot.joint].act(corner) for corner in foot.sole]) for foot in robot.feet
    }
    standing = [corners for name, corners in soles.items() if name in loaded]
    support = None
    if standing:
        ground = np.vstack(standing)
        ground[:, 2] = 0.0
        support = flat(ground[hull_outline(ground[:, :2])])
    com = None
    if robot.floating:
        centre = pin.centerOfMass(robot.model, data, q) * np.array([1.0, 1.0, 0.0])
        com = flat(centre[None])[0]
    hulls = _hull_outlines(robot, data, view, flat)
    return Picture(
        hulls=tuple(outline for link, outline in hulls if link not in marked),
        bones=tuple(flat(bone) for bone in _bone_lines(robot, data)),
        soles=tuple(flat(corners) for corners in soles.values()),
        support=support,
        com=com,
        marked=tuple(outline for link, outline in hulls if link in marked),
    )


def _bone_lines(robot: Robot, data: pin.Data) -> list[Array]:
    """Lines from each joint to its parent, and from each last one through what it carries."""
    model = robot.model
    feet = {foot.joint for foot in robot.feet}
    first = 2 if robot.floating else 1
    bones = []
    for joint in range(first, model.njoints):
        start, end = data.oMi[model.parents[joint]].translation, data.oMi[joint].translation
        bones.append(np.array([start, end]))
        if len(model.children[joint]) == 0 and joint not in feet:
            bones.append(np.array([end, data.oMi[joint].act(1.6 * model.inertias[joint].lever)]))
    for foot in robot.feet:
        pose = data.oMi[foot.joint]
        bones.append(np.array([pose.translation, pose.act(foot.placement.translation)]))
    return [bone for bone in bones if np.linalg.norm(bone[1] - bone[0]) > _SHORTEST_BONE]


def _hull_outlines(robot: Robot, data: pin.Data, view: View, flat) -> tuple[tuple[str, Array], ...]:
    """Links and outlines of their shapes, far ones first."""
    try:
        shapes = collision_shapes(robot)
    except RobotError:
        return ()  # bones alone still show the motion of a robot without geometry
    outlines = []
    for shape in shapes:
        if shape.link == TABLE:
            continue
        pose = data.oMi[shape.joint] * shape.placement
        points = shape_points(shape) @ pose.rotation.T + pose.translation
        seen = flat(points)
        corners = hull_outline(seen)
        if len(corners) > 2:
            outlines.append((float(points.mean(axis=0) @ view.towards), shape.link, seen[corners]))
    outlines.sort(key=lambda item: item[0])
    return tuple((link, corners) for _, link, corners in outlines)


def hull_outline(points: Array) -> NDArray[np.intp]:
    """Corners of the convex hull of points ``(n, 2)``, as indices anticlockwise; two or fewer if there is no area.

    The hulls of scipy take a fifth of a second to load, most of what a page's snapshots take.
    """
    outermost = (_OUTWARDS @ points.T).argmax(axis=1)
    return np.asarray(outermost[outermost != np.roll(outermost, 1)])


def shape_points(shape: Shape) -> Array:
    """Points whose convex hull is the shape, in its own frame, ``(n, 3)`` [m]; round shapes within 3 %."""
    if shape.vertices is not None:
        return shape.vertices
    if shape.kind == "box":
        corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        return corners * np.array(shape.size)
    radius = shape.size[0]
    turn = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    circle = radius * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(16)])
    if shape.kind == "cylinder":
        half = np.array([0.0, 0.0, 0.5 * shape.size[1]])
        return np.vstack([circle + half, circle - half])
    rings = [
        circle * np.array([np.cos(t), np.cos(t), 0.0]) + [0, 0, radius * np.sin(t)]
        for t in np.deg2rad([0, 30, 60])
    ]
    dome = np.vstack([*rings, [[0.0, 0.0, radius]]])
    half = np.array([0.0, 0.0, 0.5 * shape.size[1] if shape.kind == "capsule" else 0.0])
    return np.vstack([dome + half, -(dome + half)])
