"""A robot in postures, seen from one side: snapshots of motions, what is refused, and which joints move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import wrap

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import RobotError
from excite.motion.motion import Motion
from excite.report.folder import Document
from excite.report.html import format_number
from excite.report.plots.sketch import (
    Dots,
    Outlines,
    Shape,
    Sketch,
    Words,
    text_length,
)
from excite.report.replay.scene import solid_triangles
from excite.report.theme import (
    GROUND,
    IDENTIFIED,
    INK,
    MUTED,
    NOMINAL,
    PALE,
    PAPER,
    TRUE,
    WIDTH_IN,
    shorten_name,
)
from excite.robot.robot import Robot
from excite.robot.shapes.collision import TABLE, collision_shapes
from excite.robot.shapes.shape import Shape as Solid

_WIDTH = 72.0 * WIDTH_IN
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


def shape_points(shape: Solid) -> Array:
    """Points whose convex hull is the shape, in its own frame, ``(n, 3)`` [m]; round shapes within 3 %."""
    return shape.vertices if shape.vertices is not None else solid_triangles(shape.kind, shape.size)[0]


# Snapshots of motions: a row a motion, its most different postures from left to right.

# Heights of a row's title, and of a row with it at most [point].
_TITLE, _HIGHEST = 18.0, 187.0


def different_instants(motion: Motion, n: int) -> NDArray[np.int64]:
    """Indices of ``n`` samples whose postures differ most from each other, in order of time.

    Each next one is the farthest, in joint space, from those taken so far; the first is the motion's start.
    """
    postures = motion.joint_positions()
    taken = [0]
    distance = np.linalg.norm(postures - postures[0], axis=1)
    while len(taken) < min(n, motion.n_samples):
        farthest = int(np.argmax(distance))
        taken.append(farthest)
        distance = np.minimum(distance, np.linalg.norm(postures - postures[farthest], axis=1))
    return np.unique(taken)


def choose_motions(motions: Sequence[Motion], n: int) -> list[Motion]:
    """At most ``n`` motions in their order: one of each generator first, then spread over the rest."""
    first = list({motion.metadata.generator: motion for motion in reversed(motions)}.values())[::-1][:n]
    rest = [motion for motion in motions if motion not in first]
    missing = min(n - len(first), len(rest))
    if missing > 0:
        first += [rest[int(i)] for i in np.linspace(0, len(rest) - 1, missing).round()]
    return [motion for motion in motions if motion in first]


def draw_snapshots(robot: Robot, motions: Sequence[Motion], n_postures: int = 7) -> Sketch:
    """Postures of each motion from forward kinematics.

    Drawn are the links' shapes, bones from joint to joint, soles, and for a robot on feet the support polygon
    (green) with the projection of the centre of mass (point).
    """
    rows = [_snapshot_row(robot, motion, n_postures) for motion in motions]
    points = np.vstack(
        [part for row in rows for _, drawn in row for part in (*drawn.hulls, *drawn.bones, *drawn.soles)]
    )
    low, high = points.min(axis=0), points.max(axis=0)
    width = high[0] - low[0]
    ground = 0.0 if robot.floating else robot.description.collision.table_height or 0.0
    tile = _ground_tile(width, ground)
    low, high = np.minimum(low, tile.min(axis=0)), np.maximum(high, tile.max(axis=0))
    # One beside the other, with a margin above them, and below them room for a line.
    across, along = high[0] - low[0] + 1.06 * width * (n_postures - 1), 1.03 * (high[1] - low[1])
    scale = min(_WIDTH / across, (_HIGHEST - 2.0 * _TITLE) / along)
    left = 0.5 * (_WIDTH - scale * across) - scale * low[0]
    row_height = scale * along + 2.0 * _TITLE
    shapes: list[Shape] = []
    for place, (row, motion) in enumerate(zip(rows, motions, strict=True)):
        top = place * row_height
        shapes.append(Words(_motion_title(motion), (4.0, top + 0.5 * _TITLE), size=9.0))
        bottom = top + _TITLE + scale * along
        for i, (time, drawn) in enumerate(row):
            x = left + scale * 1.06 * width * i
            offset = np.array([x, bottom + scale * low[1]])
            parts = [Outlines((tile,), fill=GROUND), *drawn.shapes()]
            shapes += [shape.moved(scale, offset) for shape in parts]
            shapes.append(Words(f"{time:.1f} s", (x, bottom + 0.4 * _TITLE), MUTED, anchor="center"))
    return Sketch(_WIDTH, len(rows) * row_height, tuple(shapes))


def _snapshot_row(robot: Robot, motion: Motion, n: int) -> list[tuple[float, Picture]]:
    row = []
    for i in different_instants(motion, n):
        loaded = frozenset(foot for foot, flags in motion.contacts.items() if flags[i])
        row.append((float(motion.time[i] - motion.time[0]), draw_posture(robot, motion.q[i], loaded)))
    return row


def _motion_title(motion: Motion) -> str:
    aims = [joint.removesuffix("_joint").replace("_", " ") for joint in motion.metadata.targets]
    aim = f", aimed at {', '.join(aims[:4])}" + (" …" if len(aims) > 4 else "") if aims else ""
    return f"{motion.name} ({motion.metadata.generator.replace('_', ' ')}{aim}; {motion.duration:.1f} s)"


def _ground_tile(width: float, ground: float) -> Array:
    """Outline of the piece of ground under one posture, in picture coordinates [m]."""
    half = 0.42 * width
    return project(
        np.array([[x, y, ground] for x, y in [(half, half), (-half, half), (-half, -half), (half, -half)]])
    )


# The worst of what refuses candidates: the robot in that posture, the links concerned in another colour.

# Height of a line of a title, and of a posture, and the room about it [point].
_TITLE_LINE, _HEIGHT, _ROOM = 11.0, 200.0, 8.0
_TITLE_SIZE = 9.0


def draw_refused(robot: Robot, worst: Sequence[Document]) -> Sketch:
    """A picture each, side by side: all links pale, the links that touch (or the joint's, or the foot's) orange.

    Args:
        robot: the robot.
        worst: of a document's ``refused``, with postures.
    """
    feet = frozenset(foot.name for foot in robot.feet)
    width = _WIDTH / max(len(worst), 2)
    letters = int((width - _ROOM) / text_length("m", _TITLE_SIZE))
    titles = [[part for line in _refusal_title(item) for part in wrap(line, letters)] for item in worst]
    top = _TITLE_LINE * max(map(len, titles)) + _ROOM
    ground = 0.0 if robot.floating else robot.description.collision.table_height
    shapes: list[Shape] = []
    for place, (item, title) in enumerate(zip(worst, titles, strict=True)):
        drawn = draw_posture(robot, np.array(item["posture"]), feet, concerned_links(robot, item["where"]))
        points = np.vstack([*drawn.hulls, *drawn.marked, *drawn.bones])
        low, high = points.min(axis=0), points.max(axis=0)
        if ground is not None:
            level = float(project(np.array([[0.0, 0.0, ground]]))[0, 1])
            low[1], high[1] = min(low[1], level), max(high[1], level)
        scale = min((width - 2.0 * _ROOM) / (high[0] - low[0]), _HEIGHT / (high[1] - low[1]))
        middle = 0.5 * (low + high)
        offset = np.array([(place + 0.5) * width, top + 0.5 * _HEIGHT]) + scale * middle * [-1.0, 1.0]
        if ground is not None:
            half = 0.5 * (width - 2.0 * _ROOM) / scale
            line = np.array([[middle[0] - half, level], [middle[0] + half, level]])
            shapes.append(Outlines((line,), edge=GROUND, width=1.5, closed=False).moved(scale, offset))
        shapes += [shape.moved(scale, offset) for shape in drawn.shapes()]
        shapes += [
            Words(text, (place * width + 0.5 * _ROOM, (line + 0.5) * _TITLE_LINE), size=_TITLE_SIZE)
            for line, text in enumerate(title)
        ]
    return Sketch(_WIDTH, top + _HEIGHT + _ROOM, tuple(shapes))


def _refusal_title(item: Document) -> list[str]:
    """Reason, place and value, a line each."""
    limit = "" if item["limit"] is None else f" (limit {value_text(item, 'limit')})"
    value = "" if item["worst"] is None else f"{value_text(item, 'worst')}{limit}"
    return [part for part in (item["reason"].replace("_", " "), shorten_name(item["where"]), value) if part]


def concerned_links(robot: Robot, where: str) -> frozenset[str]:
    """Links that a refusal's place names: a pair's, the one that a joint moves, a foot's."""
    links = set(where.split(" - "))
    links |= {foot.link for foot in robot.feet if where in {foot.name, "feet"}}
    if where in robot.joint_names:
        joint = robot.model.getJointId(where)
        links |= {segment.link for segment in robot.segments if segment.joint == joint}
    return frozenset(links)


def value_text(item: Document, key: str) -> str:
    """``worst`` or ``limit`` of a refusal with its unit."""
    return "–" if item[key] is None else f"{format_number(item[key])} {item['unit']}".strip()
