"""Snapshots of motions: a row a motion, its most different postures from left to right."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.motion.motion import Motion
from excite.report.plots.body import Picture, View, front_view, picture
from excite.report.theme import GROUND, IDENTIFIED, INK, MUTED, NOMINAL, PALE, PAPER, TRUE, WIDTH_IN, draw
from excite.robot.robot import Robot

# Height of a row's title [inch].
_TITLE_IN = 0.25

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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


def plot_snapshots(robot: Robot, motions: Sequence[Motion], n_postures: int = 7) -> Figure:
    """Postures of each motion from forward kinematics.

    Drawn are the links' shapes, bones from joint to joint, soles, and for a robot on feet the support polygon
    (green) with the projection of the centre of mass (point).
    """
    view = front_view()
    rows = [_row(robot, motion, view, n_postures) for motion in motions]
    points = np.vstack(
        [part for row in rows for _, drawn in row for part in (*drawn.hulls, *drawn.bones, *drawn.soles)]
    )
    low, high = points.min(axis=0), points.max(axis=0)
    width = high[0] - low[0]
    ground = 0.0 if robot.floating else robot.description.collision.table_height or 0.0
    low[1] = min(low[1], _tile(view, width, ground)[:, 1].min())
    height = high[1] - low[1]
    row_height_in = min(2.6, 1.08 * WIDTH_IN / n_postures * height / width + 0.3)

    def paint(figure: Figure) -> None:
        share = 1.0 / len(rows)
        for place, (row, motion) in enumerate(zip(rows, motions, strict=True)):
            # Without ticks there is nothing to leave room for but the title.
            top = 1.0 - place * share
            axes = figure.add_axes((0.0, top - share, 1.0, share * (1.0 - _TITLE_IN / row_height_in)))
            for i, (time, drawn) in enumerate(row):
                x = i * 1.06 * width
                _draw_posture(axes, drawn, view, np.array([x, 0.0]), width, ground)
                axes.text(
                    x, low[1] - 0.07 * height, f"{time:.1f} s", ha="center", va="top", color=MUTED.light
                )
            axes.set(
                xlim=(low[0] - 0.02 * width, low[0] + 1.06 * width * n_postures),
                ylim=(low[1] - 0.16 * height, high[1] + 0.03 * height),
                aspect="equal",
            )
            axes.set_axis_off()
            middle = top - 0.5 * share * _TITLE_IN / row_height_in
            figure.text(0.005, middle, _title(motion), fontsize=9.0, va="center")

    return draw(paint, height_in=len(rows) * row_height_in, layout="none")


def _row(robot: Robot, motion: Motion, view: View, n: int) -> list[tuple[float, Picture]]:
    return [
        (
            float(motion.time[i] - motion.time[0]),
            picture(
                robot,
                motion.q[i],
                frozenset(foot for foot, flags in motion.contacts.items() if flags[i]),
                view,
            ),
        )
        for i in different_instants(motion, n)
    ]


def _title(motion: Motion) -> str:
    aims = [joint.removesuffix("_joint").replace("_", " ") for joint in motion.metadata.targets]
    aim = f", aimed at {', '.join(aims[:4])}" + (" …" if len(aims) > 4 else "") if aims else ""
    return f"{motion.name} ({motion.metadata.generator.replace('_', ' ')}{aim}; {motion.duration:.1f} s)"


def _tile(view: View, width: float, ground: float) -> Array:
    """Outline of the piece of ground under one posture, in picture coordinates [m]."""
    half = 0.42 * width
    corners = [[half, half], [-half, half], [-half, -half], [half, -half]]
    return view.flat(np.array([[x, y, ground] for x, y in corners]))


def _draw_posture(axes: Axes, drawn: Picture, view: View, offset: Array, width: float, ground: float) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    # All outlines of a kind as one: a patch each takes ten times as long.
    axes.fill(*(_tile(view, width, ground) + offset).T, color=GROUND.light, lw=0)
    if drawn.support is not None:
        axes.fill(*(drawn.support + offset).T, facecolor=TRUE.light, alpha=0.45, lw=0)
    hulls, soles, bones = (
        [part + offset for part in kind] for kind in (drawn.hulls, drawn.soles, drawn.bones)
    )
    pale: dict[str, Any] = {
        "facecolors": PALE.light,
        "edgecolors": PAPER.light,
        "linewidths": 0.5,
        "joinstyle": "round",
    }
    axes.add_collection(PolyCollection(hulls, **pale))
    axes.add_collection(PolyCollection(soles, facecolors="none", edgecolors=INK.light, linewidths=0.8))
    axes.add_collection(LineCollection(bones, colors=IDENTIFIED.light, linewidths=1.7, zorder=2))
    joints = np.unique(np.round(np.vstack([bone[:1] for bone in drawn.bones]), 4), axis=0)
    axes.plot(*(joints + offset).T, "o", ms=2.2, color=INK.light)
    if drawn.com is not None:
        axes.plot(*(drawn.com + offset), "o", ms=3.6, color=NOMINAL.light, mec=PAPER.light, mew=0.6)
