"""A diagnosis' held-out figures beside those of predictors that are far simpler than a simulator."""

from __future__ import annotations

from excite.report.folder import Document, Findings
from excite.report.html import Cell, html_paragraph, html_section, html_table
from excite.report.plots.forces import channel_label
from excite.report.sections.section import Section

_COLUMNS = {
    "model": "model",
    "command": "the command",
    "delayed_command": "delayed and scaled",
    "fir": "linear filter",
    "repeat": "a repeat",
}
_ANGLES = {"rad": "mrad", "m": "mm"}


class Trivial(Section):
    """A row a channel: the model's error, then the command's, its delay's, a filter's, and what repeats differ by."""

    identifier = "trivial"
    title = "Beside simple predictors"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        found = findings.diagnosis
        errors = {} if found is None else found["trivial"]
        shown = {k: v for k, v in _COLUMNS.items() if any(item[k] is not None for item in errors.values())}
        if found is None or not shown.keys() - {"model"}:
            return ""
        rows: list[tuple[Cell, ...]] = [
            (channel_label(name), _item_unit(item), *(_sized_value(item, key) for key in shown))
            for name, item in errors.items()
        ]
        said = [item["message"] for item in found["findings"] if item["code"] == "no_better_than_trivial"]
        return html_section(
            self.identifier,
            self.title,
            _lead_sentence(found, "fir" in shown),
            html_table(("channel", "unit", *shown.values()), rows),
            *(html_paragraph(f"{text[:1].upper()}{text[1:]}.", "note") for text in said),
        )


def _lead_sentence(found: Document, of_commands: bool) -> str:
    rows = "Root mean square errors on the same rows of trials that were not fitted"
    if not of_commands:
        return (
            f"{rows}: what the model leaves, and by how much one trial's reading differs from another's with the same "
            "command. Both readings have noise of their own: a perfect model leaves 0.7 of that difference, and "
            "none leaves less."
        )
    simulation = found["simulation"]
    anew = (
        f", started anew from the record every {simulation['horizon_s']:g} s"
        if simulation and simulation["before"]
        else ""
    )
    return (
        f"{rows}. The model is the simulator with the effects found{anew}. The others know no physics: the command "
        "itself; the command some time ago, scaled and offset; a linear filter of the command; another trial with the "
        "same command. What they had to learn they learnt on the trials to learn from. A model that is no better than "
        "these explains nothing that a delay does not."
    )


def _item_unit(item: Document) -> str:
    return _ANGLES.get(item["unit"], str(item["unit"]))


def _sized_value(item: Document, key: str) -> float | None:
    value = item[key]
    return None if value is None else value * (1e3 if item["unit"] in _ANGLES else 1.0)
