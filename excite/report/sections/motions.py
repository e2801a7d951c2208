"""The chosen or checked motions: pictures, what moves, and why others were rejected."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from excite.errors import ExciteError
from excite.motion.motion import Motion
from excite.report.folder import Findings
from excite.report.html import Cell, folded_content, html_paragraph, html_section, html_table, inline_figure
from excite.report.live import live_replay
from excite.report.plots.activity import draw_activity
from excite.report.plots.snapshots import choose_motions, draw_snapshots
from excite.report.replay.scene import robot_scene
from excite.report.replay.tracks import motion_tracks
from excite.report.sections.section import Section
from excite.robot.robot import Robot
from excite.shown import count

_N_PICTURES = 4
# A page of 15 MB still opens on a phone, and all else on it comes to 3 MB at most. G1 takes 7 kB a second of motion.
_MOST_BYTES = 10_000_000
_HOW = (
    "Drag the picture to look from elsewhere. One cursor runs over all plots: a click takes the robot there, a drag "
    "along a plot zooms, a double click shows all of it again."
)
_BODY = "Each row is one motion in its most different postures, grey bodies with blue bones"
_FEET = "the orange point, the centre of mass above the green support polygon, says how far it leans"


class Motions(Section):
    """Snapshots, activity of the joints, the list of motions, the count of rejections by reason."""

    identifier = "motions"
    title = "Motions"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        if findings.plan is None:
            figures = _motion_figures(findings) if findings.check is not None else []
            lead = "The motions that were checked, those that are not safe first."
            return html_section(self.identifier, self.title, lead, *figures) if figures else ""
        selected = findings.plan["selected"]
        rows: list[tuple[Cell, ...]] = [
            (entry["motion"], ", ".join(entry["segments"]), float(entry["duration_s"])) for entry in selected
        ]
        headers = ("motion", "chosen for the segments", "duration [s]")
        listing = folded_content(
            f"All {len(rows)} motions" if len(rows) > 1 else "The motion", html_table(headers, rows)
        )
        rejected = findings.plan["candidates"]["rejected"]
        reasons = sorted(rejected.items(), key=lambda item: (-item[1], item[0]))
        refused = (
            folded_content(
                f"{count(sum(rejected.values()), 'rejected candidate')}, by reason",
                html_table(
                    ("reason", "candidates"), [(reason.replace("_", " "), n) for reason, n in reasons]
                ),
            )
            if rejected
            else ""
        )
        lead = "These motions excite the segments best, and every one of them passed the checks."
        return html_section(self.identifier, self.title, lead, *_motion_figures(findings), listing, refused)


def _motion_caption(robot: Robot) -> str:
    return f"{_BODY}; {_FEET}." if robot.feet else f"{_BODY}."


def _motion_figures(findings: Findings) -> list[str]:
    robot, motions = findings.robot, _worst_first(findings)
    if robot is None or not motions:
        return []
    shown = choose_motions(motions, _N_PICTURES)
    snapshots = html_paragraph(_motion_caption(robot), "lead") + inline_figure(
        draw_snapshots(robot, shown).to_svg("Snapshots of the motions")
    )
    activity = draw_activity(robot, motions).to_svg("Peak speed of each joint in each motion")
    caption = folded_content("Which joint moves in which motion", inline_figure(activity))
    moving, left = _titled_tracks(robot, motions)
    if not moving:
        return [snapshots, caption]
    said = (
        html_paragraph(f"Not moving here, for a page shall stay small: {', '.join(left)}.", "note")
        if left
        else ""
    )
    how = html_paragraph(_HOW, "lead moving")
    return [how, live_replay("replay", robot_scene(robot), moving, snapshots), said, caption]


def _worst_first(findings: Findings) -> tuple[Motion, ...]:
    """A plan's motions in its order; of what was only checked first what is not safe: that is to be looked at."""
    judged = findings.check["motions"] if findings.check is not None and findings.plan is None else ()
    unsafe = {item["motion"] for item in judged if not item["safe"]}
    return tuple(sorted(findings.motions, key=lambda motion: motion.name not in unsafe))


def _titled_tracks(robot: Robot, motions: Sequence[Motion]) -> tuple[dict[str, Any], list[str]]:
    """Tracks of the motions by title, as many as a page has room for, and the names of the others."""
    found: dict[str, Any] = {}
    left, size = [], 0
    for motion in motions:
        if size > _MOST_BYTES:
            left.append(motion.name)
            continue
        try:
            content = motion_tracks(robot, motion).to_json()
        except ExciteError:
            left.append(motion.name)
            continue
        size += len(json.dumps(content))
        if size > _MOST_BYTES:
            left.append(motion.name)
            continue
        found[f"{motion.name} · {motion.metadata.generator.replace('_', ' ')} · {motion.duration:.1f} s"] = (
            content
        )
    return found, left
