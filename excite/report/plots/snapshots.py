"""Snapshots of motions: a row a motion, its most different postures from left to right."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.motion.motion import Motion
from excite.report.plots.body import Picture, View, draw_posture, front_view
from excite.report.plots.sketch import Dots, Outlines, Shape, Sketch, Words
from excite.report.theme import GROUND, IDENTIFIED, INK, MUTED, NOMINAL, PALE, PAPER, TRUE, WIDTH_IN
from excite.robot.robot import Robot

_WIDTH = 72.0 * WIDTH_IN
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
    view = front_view()
    rows = [_snapshot_row(robot, motion, view, n_postures) for motion in motions]
    points = np.vstack(
        [part for row in rows for _, drawn in row for part in (*drawn.hulls, *drawn.bones, *drawn.soles)]
    )
    low, high = points.min(axis=0), points.max(axis=0)
    width = high[0] - low[0]
    ground = 0.0 if robot.floating else robot.description.collision.table_height or 0.0
    tile = _ground_tile(view, width, ground)
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
            shapes += [shape.moved(scale, offset) for shape in _posture_shapes(drawn, tile)]
            shapes.append(Words(f"{time:.1f} s", (x, bottom + 0.4 * _TITLE), MUTED, anchor="center"))
    return Sketch(_WIDTH, len(rows) * row_height, tuple(shapes))


def _snapshot_row(robot: Robot, motion: Motion, view: View, n: int) -> list[tuple[float, Picture]]:
    return [
        (
            float(motion.time[i] - motion.time[0]),
            draw_posture(
                robot,
                motion.q[i],
                frozenset(foot for foot, flags in motion.contacts.items() if flags[i]),
                view,
            ),
        )
        for i in different_instants(motion, n)
    ]


def _motion_title(motion: Motion) -> str:
    aims = [joint.removesuffix("_joint").replace("_", " ") for joint in motion.metadata.targets]
    aim = f", aimed at {', '.join(aims[:4])}" + (" …" if len(aims) > 4 else "") if aims else ""
    return f"{motion.name} ({motion.metadata.generator.replace('_', ' ')}{aim}; {motion.duration:.1f} s)"


def _ground_tile(view: View, width: float, ground: float) -> Array:
    """Outline of the piece of ground under one posture, in picture coordinates [m]."""
    half = 0.42 * width
    corners = [[half, half], [-half, half], [-half, -half], [half, -half]]
    return view.flat(np.array([[x, y, ground] for x, y in corners]))


def _posture_shapes(drawn: Picture, tile: Array) -> list[Outlines | Dots]:
    shapes: list[Outlines | Dots] = [Outlines((tile,), fill=GROUND)]
    if drawn.support is not None:
        shapes.append(Outlines((drawn.support,), fill=TRUE, opacity=0.45))
    starts = np.vstack([bone[:1] for bone in drawn.bones])
    joints: Array = np.unique(np.round(starts, 4), axis=0)
    shapes += [
        Outlines(drawn.hulls, fill=PALE, edge=PAPER),
        Outlines(drawn.soles, edge=INK, width=0.8),
        Outlines(drawn.bones, edge=IDENTIFIED, width=1.7, closed=False),
        Dots(joints, 1.1, INK),
    ]
    if drawn.com is not None:
        shapes.append(Dots(drawn.com[None], 1.8, NOMINAL, PAPER))
    return shapes
