"""Sections of the page of a log that was looked through."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from excite.report.comparisons import ForceComparison
from excite.report.folder import Document, Findings
from excite.report.html import Cell, html_table, inline_figure, live_chart
from excite.report.plots.forces import MOST_PANELS, channel_label, plot_forces
from excite.report.sections.section import Content, section, section_content
from excite.report.theme import to_svg

# What is wrong with a log, worst first, and what was done or is to be done about it.

_MEANS = {
    "fatal": "nothing can be told",
    "spoils": "spoils what is computed",
    "limits": "limits what can be told",
    "note": "to know",
}
# Named places and trials.
_NAMED = 4


@section("findings", "Findings")
def show_log_findings(findings: Findings) -> Content | str:
    """A row a finding."""
    found = findings.doctor
    if found is None:
        return ""
    if not found["findings"]:
        lead = (
            "Rows, clock, units, signs, order of columns, zeros, dead and clipped channels: nothing is wrong."
        )
        return section_content(lead)
    lead = (
        "Worst first. What is mended here is mended for excite identify and excite diagnose too, which look the "
        "log through in the same way; the log itself is as it was."
    )
    if found["repaired"]:
        lead += f" A mended copy is in {found['repaired']}."
    headers = ["how bad", "what was found", "what was done, or is to be done", "where"]
    rows = [_finding_row(item) for item in found["findings"]]
    if any(item["sure"] < 1.0 for item in found["findings"]):
        headers.append("sure")
        rows = [
            (*row, f"{100.0 * item['sure']:.0f} %") for row, item in zip(rows, found["findings"], strict=True)
        ]
    return section_content(lead, html_table(headers, rows))


def _finding_row(item: Document) -> tuple[Cell, ...]:
    state = "mended" if item["repaired"] else _MEANS[item["severity"]]
    where = _list_places(item["places"])
    if item["trials"]:
        where += f"{'; ' if where else ''}in {_list_places(item['trials'])}"
    return state, item["text"], item["remedy"], where


def _list_places(names: list[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


# Torques of a log that was looked through, beside what the nominal model needs.

_MODEL, _LOGGED, _REPAIRED = "what the model needs", "as logged", "as repaired"


@section("beside-model", "Torques beside the model")
def show_torques_beside_model(findings: Findings) -> Content | str:
    """A panel a joint, those that something was found at first."""
    data = findings.data.torques
    if data is None or findings.doctor is None:
        return ""
    # Findings name joints, or channels (``tau.elbow``).
    named = {
        place.rpartition(".")[2] for finding in findings.doctor["findings"] for place in finding["places"]
    }
    order = sorted(data.channels, key=lambda name: name not in named)
    shown = _select_channels(data, order[:MOST_PANELS])
    lead = (
        f"Trial {data.trial}: the torques as they stand in the log and as they were repaired, beside those of the "
        "nominal model's bodies in the repaired motion, with an offset, friction and a rotor fitted to each joint. "
        "What is left between them may be the model's fault as well."
    )
    if len(shown.channels) < len(data.channels):
        lead += f" Drawn are {MOST_PANELS} of {len(data.channels)} joints, those of the findings first."
    svg = to_svg(
        plot_forces(shown, (_MODEL, _LOGGED, _REPAIRED)),
        "beside-model",
        "Torques as logged, as repaired and as the model needs them",
    )
    plots = live_chart("beside-model-plots", shown.time, list(_torque_panels(shown)), inline_figure(svg))
    return section_content(lead, plots)


def _select_channels(data: ForceComparison, names: list[str]) -> ForceComparison:
    at = [data.channels.index(name) for name in names]
    return replace(
        data,
        channels=tuple(names),
        units=tuple(data.units[i] for i in at),
        measured=data.measured[:, at],
        nominal=data.nominal[:, at],
        identified=data.identified[:, at],
    )


def _torque_panels(data: ForceComparison) -> Iterator[dict[str, Any]]:
    for i, (name, unit) in enumerate(zip(data.channels, data.units, strict=True)):
        series = [
            ({"label": _MODEL, "role": "ink"}, data.measured[:, i]),
            ({"label": _LOGGED, "role": "nominal", "dash": [5, 3]}, data.nominal[:, i]),
            ({"label": _REPAIRED, "role": "identified"}, data.identified[:, i]),
        ]
        yield {"title": f"{channel_label(name)} [{unit}]", "unit": unit, "series": series}
