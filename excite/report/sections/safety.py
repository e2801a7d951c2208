"""The independent verdict on the chosen motions."""

from __future__ import annotations

from excite.report.folder import Document, Findings
from excite.report.html import Cell, folded_content, html_section, html_table
from excite.report.sections.section import Section
from excite.safety.verdict import conditions
from excite.shown import count

_MARGINS = {
    "joint_position_rad": ("joint position", "rad"),
    "joint_velocity_rad_s": ("joint velocity", "rad/s"),
    "joint_acceleration_rad_s2": ("joint acceleration", "rad/s²"),
    "joint_jerk_rad_s3": ("joint jerk", "rad/s³"),
    "joint_torque_nm": ("joint torque", "N·m"),
    "self_collision_m": ("distance between bodies", "m"),
    "zmp_m": ("ZMP to the edge of support", "m"),
}
# A margin in one of the units that the robot's joints move in.
_Column = tuple[str, str]


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
        held = {one: None for motion in motions for one in motion.get("as_far_as", ())}
        if held:
            lead += f" What is safe here is safe{conditions(held)}."
        columns = [column for name in _MARGINS for column in _margin_columns(name, motions)]
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
        return html_section(self.identifier, self.title, lead, smallest, every, _violation_table(motions))


def _margin_columns(name: str, motions: list[Document]) -> list[_Column]:
    """A margin in each unit that it has: of joints that slide and of those that turn."""
    if all(name in motion["not_applicable"] for motion in motions):
        return []
    units = [one["unit"] for motion in motions for one in motion["nearest"].get(name, ())]
    return [(name, unit) for unit in dict.fromkeys(sorted(units, reverse=True) or [_MARGINS[name][1]])]


def _column_title(column: _Column) -> str:
    name, unit = column
    return f"{_MARGINS[name][0]} [{unit}]"


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
