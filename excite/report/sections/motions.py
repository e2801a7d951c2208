"""The chosen motions: pictures, what moves, and why others were rejected."""

from __future__ import annotations

from excite.report.folder import Findings
from excite.report.html import Cell, figure, folded, section, table
from excite.report.plots.activity import plot_activity
from excite.report.plots.snapshots import choose_motions, plot_snapshots
from excite.report.sections.section import Section
from excite.report.theme import to_svg

_N_PICTURES = 4
_BODY = "Each row is one motion in its most different postures, grey bodies with blue bones"
_FEET = "the orange point, the centre of mass above the green support polygon, says how far it leans"


class Motions(Section):
    """Snapshots, activity of the joints, the list of motions, the count of rejections by reason."""

    identifier = "motions"
    title = "Chosen motions"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        if findings.plan is None:
            return ""
        selected = findings.plan["selected"]
        rows: list[tuple[Cell, ...]] = [
            (entry["motion"], ", ".join(entry["segments"]), float(entry["duration_s"])) for entry in selected
        ]
        listing = folded(
            f"All {len(rows)} motions", table(("motion", "chosen for the segments", "duration [s]"), rows)
        )
        rejected = findings.plan["candidates"]["rejected"]
        reasons = sorted(rejected.items(), key=lambda item: (-item[1], item[0]))
        refused = folded(
            f"{sum(rejected.values())} rejected candidates, by reason",
            table(("reason", "candidates"), [(reason.replace("_", " "), count) for reason, count in reasons]),
        )
        return section(
            self.identifier, self.title, self._lead(findings), *_figures(findings), listing, refused
        )

    def _lead(self, findings: Findings) -> str:
        if not findings.motions or findings.robot is None:
            return "These motions excite the segments best."
        return f"{_BODY}; {_FEET}." if findings.robot.feet else f"{_BODY}."


def _figures(findings: Findings) -> list[str]:
    robot, motions = findings.robot, findings.motions
    if robot is None or not motions:
        return []
    shown = choose_motions(motions, _N_PICTURES)
    snapshots = to_svg(plot_snapshots(robot, shown), "snapshots", "Snapshots of the chosen motions")
    activity = to_svg(plot_activity(robot, motions), "activity", "Peak speed of each joint in each motion")
    caption = folded("Which joint moves in which motion", figure(activity))
    return [figure(snapshots), caption]
