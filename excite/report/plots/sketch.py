"""A drawing of outlines, dots and words, written as SVG by itself and as PNG by matplotlib.

A picture of robots is a thousand outlines, for each of which matplotlib's own SVG takes a third of a millisecond, and
matplotlib itself takes 0.3 s to load: a plan's page, which needs no curves, does without it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from html import escape
from typing import Any, Literal

import numpy as np

from excite.arrays import Array
from excite.report.theme import FONT, INK, Role, draw_figure, to_png

_POINTS_AN_INCH = 72.0
_ANCHORS = {"left": "start", "center": "middle", "right": "end"}
# A letter's width as a share of the line's height: of 272 names of joints and links of nine bundled robots in DejaVu
# Sans the mean is 0.50, and one passes this, by 5 %.
_LETTER = 0.6


def text_length(text: str, size: float) -> float:
    """About how long a line of text is [point]."""
    return _LETTER * size * len(text)


def rectangle_corners(left: float, top: float, right: float, bottom: float) -> Array:
    """Corners ``(4, 2)``."""
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


@dataclass(frozen=True, eq=False)
class Outlines:
    """Lines or areas of one look, painted one after the other.

    Attributes:
        parts: ``(n, 2)`` each.
        fill: colour of the areas; None of lines.
        edge: colour of the lines about them; None without.
        width: of the lines [point].
        opacity: of the areas, from 0 to 1.
        closed: whether the last point is joined to the first.
    """

    parts: tuple[Array, ...]
    fill: Role | None = None
    edge: Role | None = None
    width: float = 0.5
    opacity: float = 1.0
    closed: bool = True

    def moved(self, scale: float, offset: Array) -> Outlines:
        """In points, from coordinates [m] whose second axis is upward."""
        return replace(self, parts=tuple(_move_points(part, scale, offset) for part in self.parts))

    def to_svg(self) -> str:
        """A ``<g>`` element."""
        look = f"fill: {_role_colour(self.fill)}; stroke: {_role_colour(self.edge)}; stroke-width: {self.width:g}"
        if self.opacity < 1.0:
            look += f"; fill-opacity: {self.opacity:g}"
        end = "Z" if self.closed else ""
        paths = "".join(f'<path d="M{_svg_part(part)}{end}"/>' for part in self.parts)
        return f'<g style="{look}; stroke-linejoin: round; stroke-linecap: round">{paths}</g>'

    def paint(self, axes: Any) -> None:
        """The same with matplotlib."""
        from matplotlib.collections import LineCollection, PolyCollection

        look: dict[str, Any] = {"linewidths": self.width, "joinstyle": "round", "capstyle": "round"}
        edge = "none" if self.edge is None else self.edge.light
        if self.closed:
            face = "none" if self.fill is None else (self.fill.light, self.opacity)
            axes.add_collection(PolyCollection(self.parts, facecolors=face, edgecolors=edge, **look))
        else:
            axes.add_collection(LineCollection(self.parts, colors=edge, **look))


@dataclass(frozen=True, eq=False)
class Dots:
    """Dots of one look.

    Attributes:
        places: ``(n, 2)``.
        radius: [point].
        fill: their colour.
        edge: colour of a thin line about them; None without.
    """

    places: Array
    radius: float
    fill: Role
    edge: Role | None = None

    def moved(self, scale: float, offset: Array) -> Dots:
        """See :meth:`Outlines.moved`."""
        return replace(self, places=_move_points(self.places, scale, offset))

    def to_svg(self) -> str:
        """A ``<g>`` element."""
        dots = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{self.radius:g}"/>' for x, y in self.places)
        look = f"fill: {_role_colour(self.fill)}; stroke: {_role_colour(self.edge)}; stroke-width: 0.6"
        return f'<g style="{look}">{dots}</g>'

    def paint(self, axes: Any) -> None:
        """The same with matplotlib."""
        look = {"mec": "none" if self.edge is None else self.edge.light, "mew": 0.6}
        axes.plot(*self.places.T, "o", ms=2.0 * self.radius, color=self.fill.light, **look)


@dataclass(frozen=True, eq=False)
class Words:
    """A line of text.

    Attributes:
        text: what it says.
        place: of its anchor, at the middle of its height [point].
        role: its colour.
        size: height of its line [point].
        anchor: which part of it is at the place.
        bold: whether its letters are.
    """

    text: str
    place: tuple[float, float]
    role: Role = INK
    size: float = 8.5
    anchor: Literal["left", "center", "right"] = "left"
    bold: bool = False

    def to_svg(self) -> str:
        """A ``<text>`` element."""
        x, y = self.place
        font = f"{'bold ' if self.bold else ''}{self.size:g}px {FONT}"
        look = f"font: {font}; fill: {_role_colour(self.role)}; text-anchor: {_ANCHORS[self.anchor]}"
        # A capital is 0.7 of the line's height.
        place = f'x="{x:.1f}" y="{y + 0.35 * self.size:.1f}"'
        return f'<text {place} style="{look}">{escape(self.text)}</text>'

    def paint(self, axes: Any) -> None:
        """The same with matplotlib."""
        look: dict[str, Any] = {"fontsize": self.size, "color": self.role.light, "ha": self.anchor}
        look |= {"va": "center_baseline", "fontweight": "bold" if self.bold else "normal"}
        axes.text(*self.place, self.text, **look)


Shape = Outlines | Dots | Words


@dataclass(frozen=True, eq=False)
class Sketch:
    """A drawing.

    Attributes:
        width: [point].
        height: [point].
        shapes: those that cover others last; coordinates in points from the upper left corner.
    """

    width: float
    height: float
    shapes: tuple[Shape, ...]

    def to_svg(self, description: str) -> str:
        """An ``<svg>`` element for inlining; ``description`` is for readers who cannot see it."""
        size = f"0 0 {self.width:g} {self.height:.1f}"
        body = "".join(shape.to_svg() for shape in self.shapes)
        opening = f'<svg role="img" aria-label="{escape(description)}" viewBox="{size}"'
        return f'{opening} xmlns="http://www.w3.org/2000/svg">{body}</svg>'

    def to_png(self, dpi: int = 150) -> bytes:
        """The drawing on white paper."""

        def paint(figure: Any) -> None:
            axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
            for order, shape in enumerate(self.shapes):
                before = set(axes.get_children())
                shape.paint(axes)
                for artist in set(axes.get_children()) - before:
                    artist.set_zorder(order)
            axes.set(xlim=(0.0, self.width), ylim=(self.height, 0.0))
            axes.set_axis_off()

        return to_png(
            draw_figure(paint, self.height / _POINTS_AN_INCH, self.width / _POINTS_AN_INCH), dpi=dpi
        )


def _move_points(points: Array, scale: float, offset: Array) -> Array:
    return offset + scale * points * np.array([1.0, -1.0])


def _svg_part(part: Array) -> str:
    return "L".join([f"{x:.1f} {y:.1f}" for x, y in part.tolist()])


def _role_colour(role: Role | None) -> str:
    return "none" if role is None else f"var(--{role.name})"
