"""Which joints each chosen motion moves, and how fast."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from excite.arrays import Array
from excite.motion.motion import Motion
from excite.report.theme import IDENTIFIED, MUTED, draw
from excite.robot.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_KEY = (0.25, 0.5, 1.0)


def peak_speed_share(robot: Robot, motions: Sequence[Motion]) -> Array:
    """Highest speed of each joint as a share of its velocity limit, ``(n_joints, n_motions)``, no unit."""
    return np.column_stack(
        [np.abs(motion.joint_velocities()).max(axis=0) / robot.limits.velocity for motion in motions]
    )


def plot_activity(robot: Robot, motions: Sequence[Motion]) -> Figure:
    """A square a joint and motion: the fuller the colour, the nearer the joint comes to its speed limit."""
    share = peak_speed_share(robot, motions)

    def paint(figure: Figure) -> None:
        from matplotlib.collections import PolyCollection
        from matplotlib.patches import Patch

        axes = figure.subplots()
        moving = np.argwhere(share >= 0.01)
        corners = 0.46 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        # Robots with generous speed limits hardly move by this measure: there may be no square at all.
        if len(moving):
            # All squares as one: a patch each takes ten times as long.
            cells = PolyCollection(
                list(moving[:, None, ::-1] + corners),
                facecolors=IDENTIFIED.light,
                linewidths=0.0,
                alpha=[_shade(share[row, column]) for row, column in moving],
            )
            axes.add_collection(cells)
        axes.set(xlim=(-0.6, len(motions) - 0.4), ylim=(robot.n_joints - 0.4, -0.6))
        axes.set_yticks(range(robot.n_joints), [name.removesuffix("_joint") for name in robot.joint_names])
        names = [motion.name for motion in motions]
        axes.set_xticks(range(len(motions)), names, rotation=90, fontsize=7.0)
        axes.tick_params(length=0, colors=MUTED.light)
        axes.tick_params(axis="y", labelsize=7.5)
        axes.grid(visible=False)
        for spine in axes.spines.values():
            spine.set_visible(False)
        key = [Patch(color=IDENTIFIED.light, alpha=_shade(value), label=f"{value:.0%}") for value in _KEY]
        figure.legend(
            handles=key,
            loc="outside upper left",
            ncols=3,
            title="peak speed as a share of the joint's limit",
            title_fontsize=8.5,
            alignment="left",
        )

    return draw(
        paint, height_in=1.5 + 0.17 * robot.n_joints + 0.05 * max(len(motion.name) for motion in motions)
    )


def _shade(share: float) -> float:
    return round(min(1.0, 0.06 + 0.94 * float(share)), 2)
