"""Sections of a plan: excitation of each segment, the safety verdict, refused candidates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np

from excite.arrays import Array
from excite.display import count
from excite.report.comparisons import ConditioningComparison
from excite.report.folder import Document, Findings
from excite.report.html import (
    Cell,
    condition_value,
    folded_content,
    format_number,
    html_paragraph,
    html_table,
    inline_figure,
)
from excite.report.plots.body import Picture, draw_posture, front_view
from excite.report.plots.sketch import Dots, Outlines, Shape, Sketch, Words, rectangle_corners, text_length
from excite.report.sections.section import Content, section, section_content
from excite.report.theme import (
    GRID,
    GROUND,
    IDENTIFIED,
    INK,
    MUTED,
    NOMINAL,
    PALE,
    PAPER,
    TRUE,
    WIDTH_IN,
    Role,
    shorten_name,
)
from excite.robot.robot import Robot
from excite.safety.verdict import MARGINS, conditions

# How well the chosen motions excite each segment.


@section("excitation", "Excitation")
def show_excitation(findings: Findings) -> Content | str:
    """Condition numbers of the segments, before and after where both are known."""
    plan = (findings.plan or {}).get("conditioning")
    change = findings.data.conditioning
    if plan is None and change is None:
        return ""
    lead = "The shorter a bar, the more evenly the motions excite that segment's ten inertial parameters."
    content = []
    if change is not None:
        content.append(inline_figure(draw_conditioning(change).to_svg("Condition number of each segment")))
    if plan is not None:
        full, log_det = format_number(condition_value(plan["full"])), format_number(plan["log_det"])
        numbers = f"the condition number is {full}, the log-determinant of the information {log_det}."
        content.append(html_paragraph(f"Over all {plan['n_base_parameters']} base parameters {numbers}"))
        rows = [(row["segment"], condition_value(row["condition"])) for row in plan["segments"]]
        listing = html_table(("segment", "condition number"), rows)
        content.append(folded_content("Condition number of each segment", listing))
    return section_content(lead, *content)


# Condition number of each segment before and after the choice of motions.

_CONDITIONING_WIDTH = 72.0 * WIDTH_IN
_ROW = 15.0
# Heights of the bars of before and after, as shares of a row's.
_WIDE, _SLIM = 0.74, 0.36
# Room for the numbers behind the bars [point].
_NUMBERS = 90.0
_CONDITIONING_SIZE, _SMALL = 8.5, 7.0


def draw_conditioning(data: ConditioningComparison) -> Sketch:
    """Log bars, one row a segment: pale before, strong after; what nothing excites reaches the edge."""
    names = [shorten_name(name) for name in data.segments]
    values = np.array([data.before, data.after])
    finite = values[np.isfinite(values)]
    decades = max(1, int(np.ceil(np.log10(finite.max() * 1.5)))) if finite.size else 1
    left = 8.0 + max(text_length(name, _CONDITIONING_SIZE) for name in names)
    right, top = _CONDITIONING_WIDTH - _NUMBERS, 1.6 * _ROW
    bottom = top + _ROW * len(names)
    # Of what is not finite, all of the width.
    ends = left + (right - left) * np.clip(
        np.nan_to_num(np.log10(values), posinf=decades) / decades, 0.0, 1.0
    )
    shapes: list[Shape] = list(_colour_key((data.before_label, PALE), (data.after_label, IDENTIFIED)))
    marks = left + (right - left) * np.arange(decades + 1) / decades
    lines = tuple(np.array([[x, top], [x, bottom]]) for x in marks)
    shapes.append(Outlines(lines, edge=GRID, width=0.6, closed=False))
    for row, (role, high) in zip(ends, ((PALE, _WIDE), (IDENTIFIED, _SLIM)), strict=True):
        bars = [
            rectangle_corners(
                left, top + _ROW * (i + 0.5 - 0.5 * high), x, top + _ROW * (i + 0.5 + 0.5 * high)
            )
            for i, x in enumerate(row)
        ]
        shapes.append(Outlines(tuple(bars), fill=role))
    for i, (name, end) in enumerate(zip(names, ends.max(axis=0), strict=True)):
        y = top + _ROW * (i + 0.5)
        both = " → ".join(f"{value:.3g}".replace("inf", "∞") for value in values[:, i])
        shapes += [
            Words(name, (left - 4.0, y), MUTED, _CONDITIONING_SIZE, "right"),
            Words(both, (float(end) + 4.0, y), size=_SMALL),
        ]
    shapes += [
        Words(format_number(10.0**k, 1), (float(x), bottom + 0.5 * _ROW), MUTED, _CONDITIONING_SIZE, "center")
        for k, x in enumerate(marks)
    ]
    said = "condition number of the segment's ten columns (no unit, log scale, less is better)"
    shapes.append(
        Words(said, (0.5 * (left + right), bottom + 1.4 * _ROW), MUTED, _CONDITIONING_SIZE, "center")
    )
    return Sketch(_CONDITIONING_WIDTH, bottom + 2.0 * _ROW, tuple(shapes))


def _colour_key(*labels: tuple[str, Role]) -> list[Shape]:
    shapes: list[Shape] = []
    x, y = 4.0, 0.5 * _ROW
    for text, role in labels:
        shapes.append(Outlines((rectangle_corners(x, y - 4.0, x + 20.0, y + 4.0),), fill=role))
        shapes.append(Words(shorten_name(text), (x + 26.0, y), size=_CONDITIONING_SIZE))
        x += 44.0 + text_length(shorten_name(text), _CONDITIONING_SIZE)
    return shapes


# The worst of what refuses candidates: the robot in that posture, the links concerned in another colour.

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


# What refuses candidates: how many, the worst with a picture, and the change most likely to help.

# Pictures beside each other, and lines of the table that are not folded away.
_PICTURES, _LISTED = 3, 8

_BARE: Document = {"where": "–", "worst": None, "limit": None, "unit": "", "time_s": None, "posture": None}


@section("refused", "What refuses candidates")
def show_refused(findings: Findings) -> Content | str:
    """Pictures of the worst refused postures, the table, the change that was counted."""
    refused, remedy, generated = _plan_refusals(findings)
    if not refused:
        return ""
    rows = [
        (
            item["reason"].replace("_", " "),
            item["where"],
            item["candidates"],
            _value_text(item, "worst"),
            _value_text(item, "limit"),
            item["time_s"],
        )
        for item in refused
    ]
    headers = ("reason", "where", "candidates", "worst", "limit", "at [s]")
    listing = html_table(headers, rows[:_LISTED])
    if len(rows) > _LISTED:
        listing += folded_content(f"{len(rows) - _LISTED} more", html_table(headers, rows[_LISTED:]))
    lead = (
        f"Of {generated} candidates. One that breaks several limits counts with each. Limits are planning's, "
        "which keeps a reserve to what the check asks for; no time is stated of what is refused as a posture."
    )
    if remedy is not None:
        lead += (
            f" Most likely to help: {remedy['change']} ({remedy['passes']} of {remedy['tried']} that were tried "
            "again pass then)."
        )
    elif findings.plan is None:
        lead += " No single limit lifted lets any of those pass that were tried again."
    return section_content(lead, *_refusal_pictures(findings.robot, refused), listing)


class _Said(NamedTuple):
    """What refuses, the change that helps, and the number of candidates."""

    refused: list[dict[str, Any]]
    remedy: Document | None
    generated: int


def _plan_refusals(findings: Findings) -> _Said:
    """Those of a plan, or of one that has no motion."""
    if findings.refusals is not None:
        return _Said(*(findings.refusals[key] for key in ("refused", "remedy", "generated")))
    if findings.plan is not None:
        plan = findings.plan
        # What is told by no distance, as a fall in the rehearsal, has a number of candidates alone.
        measured = {item["reason"] for item in plan["refused"]}
        others = [
            _BARE | {"reason": reason, "candidates": n}
            for reason, n in plan["candidates"]["rejected"].items()
            if reason not in measured
        ]
        return _Said([*plan["refused"], *others], plan["remedy"], plan["candidates"]["generated"])
    return _Said([], None, 0)


def _refusal_pictures(robot: Robot | None, refused: list[dict[str, Any]]) -> list[str]:
    if robot is None:
        return []
    worst = [
        Worst(
            title_of(item["reason"], item["where"], _measured_value(item)),
            np.array(item["posture"]),
            item["where"],
        )
        for item in refused
        if item["posture"] is not None and len(item["posture"]) == robot.model.nq
    ][:_PICTURES]
    if not worst:
        return []
    return [
        inline_figure(draw_refused(robot, worst).to_svg("The robot in the worst of the refused postures"))
    ]


def _measured_value(item: dict[str, Any]) -> str:
    limit = "" if item["limit"] is None else f" (limit {_value_text(item, 'limit')})"
    return "" if item["worst"] is None else f"{_value_text(item, 'worst')}{limit}"


def _value_text(item: dict[str, Any], key: str) -> str:
    return "–" if item[key] is None else f"{format_number(item[key])} {item['unit']}".strip()


# The independent verdict on the chosen motions.

# A margin in one of the units that the robot's joints move in.
_Column = tuple[str, str]


@section("safety", "Safety")
def show_safety(findings: Findings) -> Content | str:
    """Smallest margins over all motions, every motion's own, violations."""
    if findings.check is None:
        return ""
    motions = findings.check["motions"]
    lead = (
        "How far the motions stay from every limit at the worst instant, by a check independent of the "
        "repairs; a margin that could not be computed counts as unsafe."
    )
    held = {one: None for motion in motions for one in motion.get("as_far_as", ())}
    if held:
        lead += f" What is safe here is safe{conditions(held)}."
    columns = [column for name in MARGINS for column in _margin_columns(name, motions)]
    smallest = html_table(
        ("margin", "smallest", "of", "in motion"), [_smallest_margins(c, motions) for c in columns]
    )
    every = folded_content(
        f"Margins of all {count(len(motions), 'motion')}",
        html_table(
            ("motion", "safe", *map(_column_title, columns)),
            [
                (m["motion"], m["safe"], *(_motion_margin(m, column)[0] for column in columns))
                for m in motions
            ],
        ),
    )
    return section_content(lead, smallest, every, _violation_table(motions))


def _margin_columns(name: str, motions: list[Document]) -> list[_Column]:
    """A margin in each unit that it has: of joints that slide and of those that turn."""
    if all(name in motion["not_applicable"] for motion in motions):
        return []
    units = [one["unit"] for motion in motions for one in motion["nearest"].get(name, ())]
    return [(name, unit) for unit in dict.fromkeys(sorted(units, reverse=True) or [MARGINS[name][1]])]


def _column_title(column: _Column) -> str:
    name, unit = column
    return f"{MARGINS[name][0]} [{unit}]"


def _motion_margin(motion: Document, column: _Column) -> tuple[float | None, str]:
    """A motion's margin, None where it was not computed, and the joint whose it is, where that is known."""
    name, unit = column
    nearest = motion["nearest"].get(name, ())
    if not nearest:
        return motion["margins"].get(name), ""
    return next(((one["value"], one["where"]) for one in nearest if one["unit"] == unit), (None, ""))


def _smallest_margins(column: _Column, motions: list[Document]) -> tuple[Cell, ...]:
    computed = [(*_motion_margin(motion, column), motion["motion"]) for motion in motions]
    known = [(value, where, motion) for value, where, motion in computed if value is not None]
    if not known:
        return (_column_title(column), None, "", "not computed")
    value, where, motion = min(known, key=lambda one: one[0])
    return (_column_title(column), float(value), where, motion)


def _violation_table(motions: list[Document]) -> str:
    rows = [
        (m["motion"], v["kind"], v["time_s"], v["where"], v["value"], v["limit"], v["unit"])
        for m in motions
        for v in m["violations"]
    ]
    if not rows:
        return ""
    return "<h3>Violations</h3>" + html_table(
        ("motion", "kind", "time [s]", "where", "value", "limit", "unit"), rows
    )
