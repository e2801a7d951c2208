"""Which joints each chosen motion moves, and how fast."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from excite.arrays import Array
from excite.motion.motion import Motion
from excite.report.plots.sketch import Outlines, Shape, Sketch, Words, rectangle_corners, text_length
from excite.report.theme import IDENTIFIED, MUTED, WIDTH_IN, shorten_name
from excite.robot.robot import Robot

_WIDTH = 72.0 * WIDTH_IN
_KEY = (0.25, 0.5, 1.0)
_LINE = 12.0
# Sizes of the names of joints and of motions [point].
_JOINTS, _MOTIONS = 7.5, 7.0
# Below this share of its speed limit a joint does not move.
_STILL = 0.01
# Columns are no wider than four rows are high.
_WIDEST = 4.0 * _LINE


def peak_speed_share(robot: Robot, motions: Sequence[Motion]) -> Array:
    """Highest speed of each joint as a share of its velocity limit, ``(n_joints, n_motions)``, no unit."""
    return np.column_stack(
        [np.abs(motion.joint_velocities()).max(axis=0) / robot.limits.velocity for motion in motions]
    )


def draw_activity(robot: Robot, motions: Sequence[Motion]) -> Sketch:
    """A square a joint and motion: the fuller the colour, the nearer the joint comes to its speed limit."""
    share = peak_speed_share(robot, motions)
    joints = [shorten_name(name.removesuffix("_joint")) for name in robot.joint_names]
    names = [shorten_name(motion.name) for motion in motions]
    left = 8.0 + max(text_length(name, _JOINTS) for name in joints)
    top, column = 2.5 * _LINE, min((_WIDTH - left) / len(names), _WIDEST)
    cells: dict[float, list[Array]] = {}
    for row, place in np.argwhere(share >= _STILL).tolist():
        x, y = left + column * place, top + _LINE * row
        cell = rectangle_corners(x + 0.04 * column, y + 0.5, x + 0.96 * column, y + _LINE - 0.5)
        cells.setdefault(_activity_shade(share[row, place]), []).append(cell)
    shapes: list[Shape] = list(_colour_key())
    shapes += [
        Outlines(tuple(parts), fill=IDENTIFIED, opacity=shade) for shade, parts in sorted(cells.items())
    ]
    shapes += [
        Words(name, (left - 4.0, top + _LINE * (row + 0.5)), MUTED, _JOINTS, "right")
        for row, name in enumerate(joints)
    ]
    bottom = top + _LINE * len(joints) + 4.0
    shapes += [
        Words(name, (left + column * (place + 0.5), bottom), MUTED, _MOTIONS, "right", upward=True)
        for place, name in enumerate(names)
    ]
    return Sketch(_WIDTH, bottom + 4.0 + max(text_length(name, _MOTIONS) for name in names), tuple(shapes))


def _colour_key() -> list[Shape]:
    said = "peak speed as a share of the joint's limit"
    shapes: list[Shape] = [Words(said, (4.0, 0.5 * _LINE))]
    x = 4.0
    for value in _KEY:
        cell = rectangle_corners(x, 1.15 * _LINE, x + 1.6 * _LINE, 1.85 * _LINE)
        shapes.append(Outlines((cell,), fill=IDENTIFIED, opacity=_activity_shade(value)))
        shapes.append(Words(f"{value:.0%}", (x + 2.0 * _LINE, 1.5 * _LINE)))
        x += 5.0 * _LINE
    return shapes


def _activity_shade(share: float) -> float:
    return round(min(1.0, 0.06 + 0.94 * float(share)), 2)
