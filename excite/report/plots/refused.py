"""The worst of what refuses candidates: the robot in that posture, the links concerned in another colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.arrays import Array
from excite.report.plots.body import Picture, front_view, picture
from excite.report.theme import GROUND, INK, NOMINAL, PALE, PAPER, TRUE, WIDTH_IN, draw, short
from excite.robot.robot import Robot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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


def plot_refused(robot: Robot, worst: Sequence[Worst]) -> Figure:
    """A picture each, side by side: all links pale, the links that touch (or the joint's, or the foot's) orange."""
    view = front_view()
    feet = frozenset(foot.name for foot in robot.feet)
    drawn = [picture(robot, item.q, feet, view, concerned(robot, item.where)) for item in worst]
    ground = 0.0 if robot.floating else robot.description.collision.table_height

    def paint(figure: Figure) -> None:
        for axes, item, one in zip(
            figure.subplots(1, len(worst), squeeze=False)[0], worst, drawn, strict=True
        ):
            _paint(axes, one)
            if ground is not None:
                axes.axhline(view.flat(np.array([[0.0, 0.0, ground]]))[0, 1], color=GROUND.light, zorder=0)
            axes.set(aspect="equal")
            axes.set_axis_off()
            axes.set_title(item.title, wrap=True)

    return draw(paint, height_in=min(4.0, WIDTH_IN / max(len(worst), 2)))


def concerned(robot: Robot, where: str) -> frozenset[str]:
    """Links that a refusal's place names: a pair's, the one that a joint moves, a foot's."""
    links = set(where.split(" - "))
    links |= {foot.link for foot in robot.feet if where in {foot.name, "feet"}}
    if where in robot.joint_names:
        joint = robot.model.getJointId(where)
        links |= {segment.link for segment in robot.segments if segment.joint == joint}
    return frozenset(links)


def _paint(axes: Axes, drawn: Picture) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    if drawn.support is not None:
        axes.fill(*drawn.support.T, facecolor=TRUE.light, alpha=0.45, lw=0)
    pale: dict[str, Any] = {"facecolors": PALE.light, "edgecolors": PAPER.light, "linewidths": 0.5}
    marked: dict[str, Any] = {
        "facecolors": NOMINAL.light,
        "edgecolors": INK.light,
        "linewidths": 0.6,
        "alpha": 0.75,
    }
    # All outlines of a kind as one: a patch each takes ten times as long.
    axes.add_collection(PolyCollection(drawn.hulls, **pale))
    axes.add_collection(PolyCollection(drawn.marked, **marked))
    axes.add_collection(LineCollection(drawn.bones, colors=INK.light, linewidths=0.8, zorder=2))
    axes.autoscale_view()
    if drawn.com is not None:
        axes.plot(*drawn.com, "o", ms=3.6, color=NOMINAL.light, mec=PAPER.light, mew=0.6)


def title_of(reason: str, where: str, value: str) -> str:
    """Reason, place and value on lines of their own."""
    return "\n".join(part for part in (reason.replace("_", " "), short(where), value) if part)
