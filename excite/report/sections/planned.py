"""Sections of a plan: excitation of each segment, the safety verdict, refused candidates."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from textwrap import wrap
from typing import Any

import numpy as np

from excite.display import count
from excite.report.comparisons import ConditioningComparison
from excite.report.folder import Document, Findings
from excite.report.html import (
    Cell,
    columns_table,
    condition_value,
    folded_content,
    format_number,
    html_paragraph,
    html_table,
    inline_figure,
)
from excite.report.plots.bars import Bars, draw_bars
from excite.report.plots.body import draw_posture, project
from excite.report.plots.sketch import Outlines, Shape, Sketch, Words, text_length
from excite.report.sections.section import Content, section, section_content
from excite.report.theme import GROUND, WIDTH_IN, shorten_name
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
        columns = {"segment": "segment", "condition number": lambda row: condition_value(row["condition"])}
        listing = columns_table(plan["segments"], columns)
        content.append(folded_content("Condition number of each segment", listing))
    return section_content(lead, *content)


def draw_conditioning(data: ConditioningComparison) -> Sketch:
    """Log bars, one row a segment: pale before, strong after; what nothing excites reaches the edge."""
    pairs = zip(data.before, data.after, strict=True)
    return draw_bars(
        Bars(
            data.segments,
            data.before,
            data.after,
            (data.before_label, data.after_label),
            "condition number of the segment's ten columns (no unit, log scale, less is better)",
            log=True,
            texts=[" → ".join(f"{value:.3g}".replace("inf", "∞") for value in pair) for pair in pairs],
        )
    )


# The worst of what refuses candidates: the robot in that posture, the links concerned in another colour.

_WIDTH = 72.0 * WIDTH_IN
# Height of a line of a title, and of a posture, and the room about it [point].
_LINE, _HEIGHT, _ROOM = 11.0, 200.0, 8.0
_SIZE = 9.0


def draw_refused(robot: Robot, worst: Sequence[Document]) -> Sketch:
    """A picture each, side by side: all links pale, the links that touch (or the joint's, or the foot's) orange.

    Args:
        robot: the robot.
        worst: of a document's ``refused``, with postures.
    """
    feet = frozenset(foot.name for foot in robot.feet)
    width = _WIDTH / max(len(worst), 2)
    letters = int((width - _ROOM) / text_length("m", _SIZE))
    titles = [[part for line in _refusal_title(item) for part in wrap(line, letters)] for item in worst]
    top = _LINE * max(map(len, titles)) + _ROOM
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
            Words(text, (place * width + 0.5 * _ROOM, (line + 0.5) * _LINE), size=_SIZE)
            for line, text in enumerate(title)
        ]
    return Sketch(_WIDTH, top + _HEIGHT + _ROOM, tuple(shapes))


def _refusal_title(item: Document) -> list[str]:
    """Reason, place and value, a line each."""
    limit = "" if item["limit"] is None else f" (limit {_value_text(item, 'limit')})"
    value = "" if item["worst"] is None else f"{_value_text(item, 'worst')}{limit}"
    return [part for part in (item["reason"].replace("_", " "), shorten_name(item["where"]), value) if part]


def concerned_links(robot: Robot, where: str) -> frozenset[str]:
    """Links that a refusal's place names: a pair's, the one that a joint moves, a foot's."""
    links = set(where.split(" - "))
    links |= {foot.link for foot in robot.feet if where in {foot.name, "feet"}}
    if where in robot.joint_names:
        joint = robot.model.getJointId(where)
        links |= {segment.link for segment in robot.segments if segment.joint == joint}
    return frozenset(links)


# What refuses candidates: how many, the worst with a picture, and the change most likely to help.

# Pictures beside each other, and lines of the table that are not folded away.
_PICTURES, _LISTED = 3, 8

_REFUSED = {
    "reason": lambda item: item["reason"].replace("_", " "),
    "where": "where",
    "candidates": "candidates",
    "worst": lambda item: _value_text(item, "worst"),
    "limit": lambda item: _value_text(item, "limit"),
    "at [s]": "time_s",
}
_BARE: Document = {"where": "–", "worst": None, "limit": None, "unit": "", "time_s": None, "posture": None}


@section("refused", "What refuses candidates")
def show_refused(findings: Findings) -> Content | str:
    """Pictures of the worst refused postures, the table, the change that was counted."""
    source, refused = _plan_refusals(findings)
    if not refused:
        return ""
    remedy = source["remedy"]
    listing = columns_table(refused[:_LISTED], _REFUSED)
    if len(refused) > _LISTED:
        listing += folded_content(
            f"{len(refused) - _LISTED} more", columns_table(refused[_LISTED:], _REFUSED)
        )
    lead = (
        f"Of {source['generated']} candidates. One that breaks several limits counts with each. Limits are planning's, "
        "which keeps a reserve to what the check asks for; no time is stated of what is refused as a posture."
    )
    if remedy is not None:
        lead += (
            f" Most likely to help: {remedy['change']} ({remedy['passes']} of {remedy['tried']} that were tried "
            "again pass then)."
        )
    elif findings.plan is None:
        lead += " No single limit lifted lets any of those pass that were tried again."
    return section_content(lead, _refusal_pictures(findings.robot, refused), listing)


def _plan_refusals(findings: Findings) -> tuple[Document, list[Document]]:
    """The document that says them, of a plan or of one that has no motion, and what refuses."""
    if findings.refusals is not None:
        return findings.refusals, findings.refusals["refused"]
    plan = findings.plan
    if plan is None:
        return {}, []
    # What is told by no distance, as a fall in the rehearsal, has a number of candidates alone.
    measured = {item["reason"] for item in plan["refused"]}
    rejected = plan["candidates"]["rejected"].items()
    others = [_BARE | {"reason": reason, "candidates": n} for reason, n in rejected if reason not in measured]
    return {**plan, "generated": plan["candidates"]["generated"]}, [*plan["refused"], *others]


def _refusal_pictures(robot: Robot | None, refused: list[Document]) -> str:
    nq = -1 if robot is None else robot.model.nq
    worst = [item for item in refused if item["posture"] is not None and len(item["posture"]) == nq]
    if robot is None or not worst:
        return ""
    drawing = draw_refused(robot, worst[:_PICTURES])
    return inline_figure(drawing.to_svg("The robot in the worst of the refused postures"))


def _value_text(item: Document, key: str) -> str:
    return "–" if item[key] is None else f"{format_number(item[key])} {item['unit']}".strip()


# The independent verdict on the chosen motions.

# A margin in one of the units that the robot's joints move in.
_Column = tuple[str, str]
_VIOLATIONS = {
    **{"motion": "motion", "kind": "kind", "time [s]": "time_s", "where": "where"},
    **{"value": "value", "limit": "limit", "unit": "unit"},
}


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
    every: dict[str, Any] = {"motion": "motion", "safe": "safe"}
    every |= {_column_title(one): partial(_margin_value, one) for one in columns}
    violations = [{**one, "motion": m["motion"]} for m in motions for one in m["violations"]]
    return section_content(
        lead,
        smallest,
        folded_content(f"Margins of all {count(len(motions), 'motion')}", columns_table(motions, every)),
        "<h3>Violations</h3>" + columns_table(violations, _VIOLATIONS) if violations else "",
    )


def _margin_columns(name: str, motions: list[Document]) -> list[_Column]:
    """A margin in each unit that it has: of joints that slide and of those that turn."""
    if all(name in motion["not_applicable"] for motion in motions):
        return []
    units = [one["unit"] for motion in motions for one in motion["nearest"].get(name, ())]
    return [(name, unit) for unit in dict.fromkeys(sorted(units, reverse=True) or [MARGINS[name][1]])]


def _column_title(column: _Column) -> str:
    name, unit = column
    return f"{MARGINS[name][0]} [{unit}]"


def _motion_margin(column: _Column, motion: Document) -> tuple[float | None, str]:
    """A motion's margin, None where it was not computed, and the joint whose it is, where that is known."""
    name, unit = column
    nearest = motion["nearest"].get(name, ())
    if not nearest:
        return motion["margins"].get(name), ""
    return next(((one["value"], one["where"]) for one in nearest if one["unit"] == unit), (None, ""))


def _margin_value(column: _Column, motion: Document) -> float | None:
    return _motion_margin(column, motion)[0]


def _smallest_margins(column: _Column, motions: list[Document]) -> tuple[Cell, ...]:
    computed = [(*_motion_margin(column, motion), motion["motion"]) for motion in motions]
    known = [(value, where, motion) for value, where, motion in computed if value is not None]
    value, where, motion = min(known, key=lambda one: one[0]) if known else (None, "", "not computed")
    return (_column_title(column), value, where, motion)


# What no file said of the robot, and what follows from the values taken for it.


@section("assumed", "Assumed")
def show_assumed(findings: Findings) -> Content | str:
    """Everything that the robot's description assumed."""
    assumed = (findings.plan or findings.refusals or findings.check or {}).get("assumed", [])
    if not assumed:
        return ""
    lead = (
        "Neither the model nor its maker's files say these things of the robot. What the page finds safe is safe "
        "as far as they hold: state in robot.yaml what is known better, take it out of the list assumed there, and "
        "plan again."
    )
    columns = {"what": "what", "taken": "value", "what follows": "consequence"}
    return section_content(lead, columns_table(assumed, columns))


# How long each stage of the plan took.


@section("stages", "Time taken")
def show_stages(findings: Findings) -> Content | str:
    """Seconds by stage."""
    stages = (findings.plan or {}).get("stages")
    if not stages:
        return ""
    columns = {"stage": "stage", "time [s]": lambda one: round(float(one["seconds"]), 2)}
    total = ("all", sum(float(entry["seconds"]) for entry in stages))
    lead = "The plan's stages in the order in which they ran."
    return section_content(lead, columns_table(stages, columns, total))
