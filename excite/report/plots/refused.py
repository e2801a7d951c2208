"""The worst of what refuses candidates: the robot in that posture, the links concerned in another colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import wrap

import numpy as np

from excite.arrays import Array
from excite.report.plots.body import Picture, draw_posture, front_view
from excite.report.plots.sketch import Dots, Outlines, Shape, Sketch, Words, text_length
from excite.report.theme import GROUND, INK, NOMINAL, PALE, PAPER, TRUE, WIDTH_IN, shorten_name
from excite.robot.robot import Robot

_WIDTH = 72.0 * WIDTH_IN
# Height of a line of a title, and of a posture, and the room about it [point].
_LINE, _HEIGHT, _ROOM = 11.0, 200.0, 8.0
_SIZE = 9.0


@dataclass(frozen=True, eq=False)
class Worst:
    """A posture that is refused.

    Attributes:
        title: what refuses it.
        q: configuration ``(nq,)``.
        where: pair of links, joint, foot or contact.
    """

    title: str
    q: Array
    where: str


def draw_refused(robot: Robot, worst: Sequence[Worst]) -> Sketch:
    """A picture each, side by side: all links pale, the links that touch (or the joint's, or the foot's) orange."""
    view = front_view()
    feet = frozenset(foot.name for foot in robot.feet)
    width = _WIDTH / max(len(worst), 2)
    letters = int((width - _ROOM) / text_length("m", _SIZE))
    titles = [[part for line in item.title.split("\n") for part in wrap(line, letters)] for item in worst]
    top = _LINE * max(map(len, titles)) + _ROOM
    ground = 0.0 if robot.floating else robot.description.collision.table_height
    shapes: list[Shape] = []
    for place, (item, title) in enumerate(zip(worst, titles, strict=True)):
        drawn = draw_posture(robot, item.q, feet, view, concerned_links(robot, item.where))
        points = np.vstack([*drawn.hulls, *drawn.marked, *drawn.bones])
        low, high = points.min(axis=0), points.max(axis=0)
        if ground is not None:
            level = float(view.flat(np.array([[0.0, 0.0, ground]]))[0, 1])
            low[1], high[1] = min(low[1], level), max(high[1], level)
        scale = min((width - 2.0 * _ROOM) / (high[0] - low[0]), _HEIGHT / (high[1] - low[1]))
        middle = 0.5 * (low + high)
        offset = np.array([(place + 0.5) * width, top + 0.5 * _HEIGHT]) + scale * middle * np.array(
            [-1.0, 1.0]
        )
        if ground is not None:
            half = 0.5 * (width - 2.0 * _ROOM) / scale
            line = np.array([[middle[0] - half, level], [middle[0] + half, level]])
            shapes.append(Outlines((line,), edge=GROUND, width=1.5, closed=False).moved(scale, offset))
        shapes += [shape.moved(scale, offset) for shape in _posture_shapes(drawn)]
        shapes += [
            Words(text, (place * width + 0.5 * _ROOM, (line + 0.5) * _LINE), size=_SIZE)
            for line, text in enumerate(title)
        ]
    return Sketch(_WIDTH, top + _HEIGHT + _ROOM, tuple(shapes))


def concerned_links(robot: Robot, where: str) -> frozenset[str]:
    """Links that a refusal's place names: a pair's, the one that a joint moves, a foot's."""
    links = set(where.split(" - "))
    links |= {foot.link for foot in robot.feet if where in {foot.name, "feet"}}
    if where in robot.joint_names:
        joint = robot.model.getJointId(where)
        links |= {segment.link for segment in robot.segments if segment.joint == joint}
    return frozenset(links)


def _posture_shapes(drawn: Picture) -> list[Outlines | Dots]:
    shapes: list[Outlines | Dots] = []
    if drawn.support is not None:
        shapes.append(Outlines((drawn.support,), fill=TRUE, opacity=0.45))
    shapes += [
        Outlines(drawn.hulls, fill=PALE, edge=PAPER),
        Outlines(drawn.marked, fill=NOMINAL, edge=INK, width=0.6, opacity=0.75),
        Outlines(drawn.bones, edge=INK, width=0.8, closed=False),
    ]
    if drawn.com is not None:
        shapes.append(Dots(drawn.com[None], 1.8, NOMINAL, PAPER))
    return shapes


def title_of(reason: str, where: str, value: str) -> str:
    """Reason, place and value on lines of their own."""
    return "\n".join(part for part in (reason.replace("_", " "), shorten_name(where), value) if part)
