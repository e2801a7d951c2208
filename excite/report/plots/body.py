"""A robot in one posture as flat polygons and bones, seen from one side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import RobotError
from excite.report.plots.sketch import Dots, Outlines
from excite.report.replay.scene import solid_triangles
from excite.report.theme import IDENTIFIED, INK, NOMINAL, PALE, PAPER, TRUE
from excite.robot.robot import Robot
from excite.robot.shapes.collision import TABLE, collision_shapes
from excite.robot.shapes.shape import Shape

# The picture's axes in the world, and the direction to the viewer: from the front, a little to the robot's left and a
# little from above.
_AZIMUTH, _ELEVATION = np.deg2rad(38.0), np.deg2rad(12.0)
_FORWARD = np.array([np.cos(_AZIMUTH), np.sin(_AZIMUTH), 0.0])
_RIGHT = np.array([-_FORWARD[1], _FORWARD[0], 0.0])
_UP = np.array([0.0, 0.0, np.cos(_ELEVATION)]) - np.sin(_ELEVATION) * _FORWARD
_TOWARDS = np.array([0.0, 0.0, np.sin(_ELEVATION)]) + np.cos(_ELEVATION) * _FORWARD
_SHORTEST_BONE = 0.01
# Sides from which outlines are looked at for their outermost corners. A corner that is missed sticks out from the line
# between its neighbours by less than 0.7 % of what that is long, of a trunk less than a picture's dot.
_SIDES = 2.0 * np.pi * np.arange(256) / 256
_OUTWARDS = np.column_stack([np.cos(_SIDES), np.sin(_SIDES)])


def project(points: Array) -> Array:
    """Picture coordinates ``(n, 2)`` of world points ``(n, 3)`` [m]."""
    return np.column_stack([points @ _RIGHT, points @ _UP])


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

    def shapes(self) -> list[Outlines | Dots]:
        """Support in green, pale bodies, marked ones in orange, soles, blue bones, the centre of mass."""
        joints: Array = np.unique(np.round(np.vstack([bone[:1] for bone in self.bones]), 4), axis=0)
        ground = [] if self.support is None else [Outlines((self.support,), fill=TRUE, opacity=0.45)]
        mass = [] if self.com is None else [Dots(self.com[None], 1.8, NOMINAL, PAPER)]
        return [
            *ground,
            Outlines(self.hulls, fill=PALE, edge=PAPER),
            Outlines(self.marked, fill=NOMINAL, edge=INK, width=0.6, opacity=0.75),
            Outlines(self.soles, edge=INK, width=0.8),
            Outlines(self.bones, edge=IDENTIFIED, width=1.7, closed=False),
            Dots(joints, 1.1, INK),
            *mass,
        ]


def draw_posture(
    robot: Robot, q: Array, loaded: frozenset[str], marked: frozenset[str] = frozenset()
) -> Picture:
    """Draw a posture.

    Args:
        robot: the robot.
        q: configuration, ``(nq,)``.
        loaded: names of the feet that carry load.
        marked: links to mark.
    """
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    origin = np.array([q[0], q[1], 0.0]) if robot.floating else np.zeros(3)
    flat = np.array([1.0, 1.0, 0.0])
    soles = {
        foot.name: np.array([data.oMi[foot.joint].act(corner) for corner in foot.sole]) - origin
        for foot in robot.feet
    }
    standing = [corners * flat for name, corners in soles.items() if name in loaded]
    support = com = None
    if standing:
        ground = np.vstack(standing)
        support = project(ground[hull_outline(ground[:, :2])])
    if robot.floating:
        com = project(((pin.centerOfMass(robot.model, data, q) - origin) * flat)[None])[0]
    hulls = _hull_outlines(robot, data, origin)
    return Picture(
        hulls=tuple(outline for link, outline in hulls if link not in marked),
        bones=tuple(project(bone - origin) for bone in _bone_lines(robot, data)),
        soles=tuple(project(corners) for corners in soles.values()),
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


def _hull_outlines(robot: Robot, data: pin.Data, origin: Array) -> tuple[tuple[str, Array], ...]:
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
        seen = project(points - origin)
        corners = hull_outline(seen)
        if len(corners) > 2:
            outlines.append((float(points.mean(axis=0) @ _TOWARDS), shape.link, seen[corners]))
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
    return shape.vertices if shape.vertices is not None else solid_triangles(shape.kind, shape.size)[0]
