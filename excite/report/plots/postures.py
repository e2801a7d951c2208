"""A robot in postures, seen from one side: snapshots of motions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array, Indices
from excite.motion.motion import Motion
from excite.report.replay.scene import shape_bodies
from excite.report.theme import (
    GROUND,
    INK,
    LINE_IN,
    MUTED,
    NOMINAL,
    PALE,
    PAPER,
    TRUE,
    WIDTH_IN,
    draw_figure,
)
from excite.robot.robot import Robot
from excite.robot.shapes.shape import joints_at, place_points

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The picture's axes in the world, and the direction to the viewer: from the front, a little to the robot's left and a
# little from above.
_AZIMUTH, _ELEVATION = np.deg2rad(38.0), np.deg2rad(12.0)
_FORWARD = np.array([np.cos(_AZIMUTH), np.sin(_AZIMUTH), 0.0])
_RIGHT = np.array([-_FORWARD[1], _FORWARD[0], 0.0])
_UP = np.array([0.0, 0.0, np.cos(_ELEVATION)]) - np.sin(_ELEVATION) * _FORWARD
_TOWARDS = np.array([0.0, 0.0, np.sin(_ELEVATION)]) + np.cos(_ELEVATION) * _FORWARD
_FLAT = np.array([1.0, 1.0, 0.0])
# Sides from which outlines are looked at for their outermost corners. A corner that is missed sticks out from the line
# between its neighbours by less than 0.7 % of what that is long, of a trunk less than a picture's dot.
_SIDES = 2.0 * np.pi * np.arange(256) / 256
_OUTWARDS = np.column_stack([np.cos(_SIDES), np.sin(_SIDES)])
# A row of snapshots is no higher [inch].
_ROW_IN = 2.1


def project_points(points: Array) -> Array:
    """Picture coordinates ``(n, 2)`` of world points ``(n, 3)`` [m]."""
    return np.column_stack([points @ _RIGHT, points @ _UP])


def hull_outline(points: Array) -> NDArray[np.intp]:
    """Corners of the convex hull of points ``(n, 2)``, as indices anticlockwise; two or fewer if there is no area.

    The hulls of scipy take a fifth of a second to load.
    """
    outermost = (_OUTWARDS @ points.T).argmax(axis=1)
    return np.asarray(outermost[outermost != np.roll(outermost, 1)])


class Picture(NamedTuple):
    """What to draw of one posture, in picture coordinates relative to a point on the ground [m].

    Attributes:
        hulls: outlines of the links' shapes, far ones first, each ``(n, 2)``.
        soles: outlines of the soles, each ``(n_corners, 2)``.
        support: outline of the support polygon, ``(n, 2)``; None where nothing stands on the ground.
        com: centre of mass projected on the ground, ``(2,)``; None for a fixed base.
    """

    hulls: list[Array]
    soles: list[Array]
    support: Array | None
    com: Array | None

    @property
    def ends(self) -> tuple[Array, Array]:
        """Lowest and highest coordinates, ``(2,)`` each."""
        points = np.vstack([*self.hulls, *self.soles])
        return points.min(axis=0), points.max(axis=0)

    def paint_on(self, axes: Axes, offset: Array) -> None:
        """Support in green, pale bodies, soles, the centre of mass."""
        from matplotlib.collections import PolyCollection

        areas: tuple[tuple[list[Array], dict[str, Any]], ...] = (
            ([] if self.support is None else [self.support], {"fc": (TRUE.light, 0.45), "ec": "none"}),
            (self.hulls, {"fc": PALE.light, "ec": MUTED.light, "lw": 0.5}),
            (self.soles, {"fc": "none", "ec": INK.light, "lw": 0.8}),
        )
        for parts, look in areas:
            drawn = [part + offset for part in parts]
            axes.add_collection(PolyCollection(drawn, zorder=2.0, clip_on=False, **look))
        if self.com is not None:
            look = {"ms": 3.6, "mec": PAPER.light, "mew": 0.6, "color": NOMINAL.light, "zorder": 2.0}
            axes.plot(*(self.com + offset), "o", **look)


def draw_posture(robot: Robot, q: Array, loaded: frozenset[str]) -> Picture:
    """Draw a posture.

    Args:
        q: configuration, ``(nq,)``.
        loaded: names of the feet that carry load.
    """
    data = joints_at(robot.model, q)
    origin = np.array([q[0], q[1], 0.0]) if robot.floating else np.zeros(3)
    soles = {
        foot.name: place_points(np.array(foot.sole), data.oMi[foot.joint]) - origin for foot in robot.feet
    }
    standing = [corners * _FLAT for name, corners in soles.items() if name in loaded]
    ground = np.vstack(standing) if standing else None
    mass = (pin.centerOfMass(robot.model, data, q) - origin) * _FLAT if robot.floating else None
    outlines = []
    for body in shape_bodies(robot):
        points = place_points(body.corners, data.oMi[body.joint]) - origin
        seen = project_points(points)
        corners = hull_outline(seen)
        if len(corners) > 2:
            outlines.append((float(points.mean(axis=0) @ _TOWARDS), seen[corners]))
    outlines.sort(key=lambda item: item[0])
    return Picture(
        hulls=[outline for _, outline in outlines],
        soles=[project_points(corners) for corners in soles.values()],
        support=None if ground is None else project_points(ground[hull_outline(ground[:, :2])]),
        com=None if mass is None else project_points(mass[None])[0],
    )


def _prepare_axes(axes: Axes, title: str, low: Array, high: Array) -> None:
    axes.set_aspect("equal")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.set_title(title, fontsize=9.0)
    axes.set_axis_off()


def different_instants(motion: Motion, n: int) -> Indices:
    """Indices of ``n`` samples whose postures differ most from each other, in order of time.

    Each next one is the farthest, in joint space, from those taken so far; the first is the motion's start.
    """
    postures, taken = motion.joint_positions(), [0]
    distance = np.full(motion.n_samples, np.inf)
    while len(taken) < min(n, motion.n_samples):
        distance = np.minimum(distance, np.linalg.norm(postures - postures[taken[-1]], axis=1))
        taken.append(int(np.argmax(distance)))
    return np.unique(taken)


def choose_motions(motions: Sequence[Motion], n: int) -> list[Motion]:
    """At most ``n`` motions in their order: one of each generator first, then spread over the rest."""
    first = list({motion.metadata.generator: motion for motion in reversed(motions)}.values())[::-1][:n]
    rest = [motion for motion in motions if motion not in first]
    missing = max(0, min(n - len(first), len(rest)))
    first += [rest[int(i)] for i in np.linspace(0, len(rest) - 1, missing).round()]
    return [motion for motion in motions if motion in first]


def draw_snapshots(robot: Robot, motions: Sequence[Motion], n_postures: int = 7) -> Figure:
    """A row a motion, its most different postures from left to right, from forward kinematics.

    Drawn are the links' shapes, soles, and for a robot on feet the support polygon (green) with the projection of the
    centre of mass (point).
    """
    rows = []
    for motion in motions:
        loaded = [
            (i, {f for f, on in motion.contacts.items() if on[i]})
            for i in different_instants(motion, n_postures)
        ]
        rows.append(
            [(motion.time[i], draw_posture(robot, motion.q[i], frozenset(feet))) for i, feet in loaded]
        )
    low, high = (
        np.array(ends) for ends in zip(*(drawn.ends for row in rows for _, drawn in row), strict=True)
    )
    low, high = low.min(axis=0), high.max(axis=0)
    width = 1.06 * (high[0] - low[0])
    ground = 0.0 if robot.floating else robot.description.collision.table_height or 0.0
    corners = 0.4 * width * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    tile = project_points(np.column_stack([corners, np.full(4, ground)]))
    low, high = np.minimum(low, tile.min(axis=0)), np.maximum(high, tile.max(axis=0))
    # Below the postures is room for a line.
    high = high + np.array([width * (n_postures - 1), 0.0])
    low = low - [0.0, 0.1 * (high[1] - low[1])]
    row_in = min(WIDTH_IN * (high[1] - low[1]) / (high[0] - low[0]), _ROW_IN) + LINE_IN

    def paint_postures(figure: Figure) -> None:
        for axes, row, motion in zip(
            figure.subplots(len(rows), squeeze=False).flat, rows, motions, strict=True
        ):
            aims = [joint.removesuffix("_joint").replace("_", " ") for joint in motion.metadata.targets]
            aim = f", aimed at {', '.join(aims[:4])}" + (" …" if len(aims) > 4 else "") if aims else ""
            generator = motion.metadata.generator.replace("_", " ")
            _prepare_axes(axes, f"{motion.name} ({generator}{aim}; {motion.duration:.1f} s)", low, high)
            for i, (time, drawn) in enumerate(row):
                offset = np.array([width * i, 0.0])
                axes.fill(*(tile + offset).T, color=GROUND.light)
                drawn.paint_on(axes, offset)
                axes.text(offset[0], low[1], f"{time - motion.time[0]:.1f} s", color=MUTED.light, ha="center")

    return draw_figure(paint_postures, height_in=row_in * len(rows))
