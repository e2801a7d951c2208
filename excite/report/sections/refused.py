"""What refuses candidates: how many, the worst with a picture, and the change most likely to help."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from excite.report.folder import Document, Findings
from excite.report.html import folded_content, format_number, html_section, html_table, inline_figure
from excite.report.plots.refused import Worst, draw_refused, title_of
from excite.report.sections.section import Section
from excite.robot.robot import Robot

# Pictures beside each other, and lines of the table that are not folded away.
_PICTURES, _LISTED = 3, 8

_BARE: Document = {"where": "–", "worst": None, "limit": None, "unit": "", "time_s": None, "posture": None}


class Refused(Section):
    """Pictures of the worst refused postures, the table, the change that was counted."""

    identifier = "refused"
    title = "What refuses candidates"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
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
        return html_section(
            self.identifier, self.title, lead, *_refusal_pictures(findings.robot, refused), listing
        )


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
