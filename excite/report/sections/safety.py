"""The independent verdict on the chosen motions."""

from __future__ import annotations

from typing import Any

from excite.report.folder import Findings
from excite.report.html import Cell, folded, section, table
from excite.report.sections.section import Section

_MARGINS = {
    "joint_position_rad": "joint position [rad]",
    "joint_velocity_rad_s": "joint velocity [rad/s]",
    "joint_acceleration_rad_s2": "joint acceleration [rad/s²]",
    "joint_torque_nm": "joint torque [N·m]",
    "self_collision_m": "distance between bodies [m]",
    "zmp_m": "ZMP to the edge of support [m]",
}


class Safety(Section):
    """Smallest margins over all motions, every motion's own, violations."""

    identifier = "safety"
    title = "Safety"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        if findings.check is None:
            return ""
        motions = findings.check["motions"]
        lead = (
            "How far the motions stay from every limit at the worst instant, by a check independent of the "
            "repairs; a margin that could not be computed counts as unsafe."
        )
        named = [name for name in _MARGINS if any(name not in motion["not_applicable"] for motion in motions)]
        smallest = table(("margin", "smallest", "in motion"), [_smallest(name, motions) for name in named])
        every = folded(
            f"Margins of all {len(motions)} motions",
            table(
                ("motion", "safe", *(_MARGINS[name] for name in named)),
                [(m["motion"], m["safe"], *(m["margins"][name] for name in named)) for m in motions],
            ),
        )
        return section(self.identifier, self.title, lead, smallest, every, _violations(motions))


def _smallest(name: str, motions: list[dict[str, Any]]) -> tuple[Cell, ...]:
    computed = [m for m in motions if m["margins"][name] is not None]
    if not computed:
        return (_MARGINS[name], None, "not computed")
    worst = min(computed, key=lambda m: m["margins"][name])
    return (_MARGINS[name], float(worst["margins"][name]), worst["motion"])


def _violations(motions: list[dict[str, Any]]) -> str:
    rows = [
        (m["motion"], v["kind"], v["time_s"], v["where"], v["value"], v["limit"])
        for m in motions
        for v in m["violations"]
    ]
    if not rows:
        return ""
    return "<h3>Violations</h3>" + table(("motion", "kind", "time [s]", "where", "value", "limit"), rows)
