"""Sections of an identification: masses, prediction of the sensors, parameters, signal processing, sessions."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.display import span
from excite.identification.judgement.judgement import said_rsd
from excite.logs.signals.trace import SignalTrace, trace_from_json
from excite.report.comparisons import ForceComparison, MassComparison, ReportData
from excite.report.folder import Document, Findings
from excite.report.html import (
    Columns,
    Said,
    columns_table,
    folded_content,
    format_number,
    html_paragraph,
    html_table,
    inline_figure,
    named_rows,
)
from excite.report.plots.bars import Bars, draw_bars
from excite.report.plots.curves import MOST_PANELS, channel_label, channel_panels, show_panels
from excite.report.plots.sketch import Sketch
from excite.report.sections.section import Content, section, section_content
from excite.report.theme import IDENTIFIED, NOMINAL, draw_figure, save_png, shorten_name, to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The report's section on the masses of the segments.


@section("masses", "Masses")
def show_masses(findings: Findings) -> Content | str:
    """Nominal, identified and, on a virtual robot, true masses."""
    data = findings.data.masses
    if data is None:
        return ""
    lead = "Where the blue bar leaves the pale one, the robot is not the model that was supplied"
    lead += (
        "; the green tick is the truth, which only a virtual robot tells." if data.true is not None else "."
    )
    if data.half_width is not None:
        lead += (
            " Lines are 95 % intervals of the data and of what the nominal model is granted together: where the "
            "data tell little of a mass by itself, as of neighbours whose sum they tell, it is as wide as that."
        )
    if data.changed is not None and data.changed.any():
        names = [name for name, changed in zip(data.names, data.changed, strict=True) if changed]
        lead += (
            " In bold, the fewest segments that, changed in mass, centre of mass or inertia, explain what the "
            f"nominal model leaves: {', '.join(names)}. A robot whose bodies all differ a little shows itself so "
            "too; Differences lists what the data tell of each parameter by itself."
        )
    drawing = draw_masses(data).to_svg("Mass of each segment: nominal, identified, true")
    return section_content(lead, inline_figure(drawing), folded_content("Numbers", _mass_numbers(data)))


def _mass_numbers(data: MassComparison) -> str:
    summed = {"nominal [kg]": data.nominal, "identified [kg]": data.identified, "true [kg]": data.true}
    told = None if data.determined is None else 100.0 * data.determined
    # Masses of neighbours are known together, so that their intervals do not add up.
    more = {"± 95 % [kg]": data.half_width, "told by the data [%]": told}
    order = ("nominal [kg]", "identified [kg]", *more, "true [kg]")
    columns = {name: found for name in order if (found := {**summed, **more}[name]) is not None}
    rows = [(name, *map(float, row)) for name, *row in zip(data.names, *columns.values(), strict=True)]
    sums = (float(np.sum(column)) if name in summed else "" for name, column in columns.items())
    return html_table(["segment", *columns], rows, ("all", *sums))


def draw_masses(data: MassComparison) -> Sketch:
    """One row a segment: pale bar nominal, strong bar identified, its interval, tick true; changed ones in bold."""
    changed = np.zeros(len(data.names), dtype=bool) if data.changed is None else data.changed
    return draw_bars(
        Bars(
            data.names,
            data.nominal,
            data.identified,
            ("nominal", "identified", "95 %", "true"),
            "mass [kg]",
            half_width=data.half_width,
            ticks=data.true,
            bold={name for name, bold in zip(data.names, changed, strict=True) if bold},
        )
    )


# The steps of the signal processing, one a panel: before pale, after strong.


def plot_signals(trace: SignalTrace) -> Figure:
    """Two panels a row, in the order of the steps; what each did is in its caption on the page."""
    rows = math.ceil(len(trace.steps) / 2)

    def paint(figure: Figure) -> None:
        panels = figure.subplots(rows, 2, squeeze=False).ravel()
        for axes in panels[len(trace.steps) :]:
            axes.set_visible(False)
        for number, (axes, step) in enumerate(zip(panels, trace.steps, strict=False), start=1):
            axes.plot(step.before_x, step.before, color=NOMINAL.light, lw=0.9, label="before")
            style: dict[str, Any] = {"ls": "none", "marker": "o", "ms": 2.8} if step.dots else {"lw": 1.3}
            axes.plot(step.after_x, step.after, color=IDENTIFIED.light, label="after", **style)
            axes.set_title(f"{number} {shorten_name(step.name)}")
            axes.set(xlabel=shorten_name(step.axis), ylabel=shorten_name(step.quantity))
            axes.margins(x=0.01)
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=2)

    return draw_figure(paint, height_in=0.5 + 2.05 * rows)


def save_signal_figure(trace: SignalTrace, path: Path) -> Path:
    """Write the figure as a PNG; appears only when complete.

    Args:
        trace: what :func:`excite.recordings.explain_signals` found.
        path: the PNG to write.

    Returns:
        The file.
    """
    return save_png(plot_signals(trace), path)


# How well the models predict what the sensors measured.

# Of wrenches in documents that do not say it.
_UNITS = {"f": "N", "t": "N·m"}


@section("forces", "Prediction of forces")
def show_forces(findings: Findings) -> Content | str:
    """Measured, nominal and identified on one trial; RMSE and correlation of all trials."""
    data = _from_zero(findings.data)
    identification = findings.identification or {}
    blocks = [
        (
            "Cross validation (trials that the identification has not seen)",
            identification.get("validation"),
        ),
        ("Direct validation (trials that it was identified from)", identification.get("fit")),
    ]
    tables = [f"<h3>{title}</h3>{columns_table(named_rows(rows), _FITS)}" for title, rows in blocks if rows]
    if data is None and not tables:
        return ""
    content = []
    lead = "RMSE should fall and correlation rise from the nominal to the identified model."
    if data is not None:
        lead = (
            f"On {data.trial}, which the identification has not seen, the blue line of the identified "
            "model should cover the measured one, and the dashed nominal one should not."
        )
        if findings.human is not None and tables:
            lead += (
                " The curves are the ground reaction in the laboratory's axes, with moments about a point on the "
                "ground below the pelvis, as under Person; the tables are of the same wrench in the pelvis' axes, "
                "about its origin, as it was fitted: other figures of the same trials."
            )
        if len(data.channels) > MOST_PANELS:
            lead += f" Drawn are the first {MOST_PANELS} of {len(data.channels)} channels."
        said = "Measured and predicted forces of a validation trial"
        content.append(show_panels("forces", data.time, channel_panels(data), said))
    return section_content(lead, *content, *tables)


def _from_zero(data: ReportData) -> ForceComparison | None:
    """The curves with the trial's own time, by which it is shown in motion; a record's clock may start anywhere."""
    forces, path = data.forces, data.path
    if forces is None:
        return None
    same = path is not None and path.trial == forces.trial
    return replace(forces, time=forces.time - (path.time[0] if path is not None and same else forces.time[0]))


_FITS: Columns = {
    "channel": lambda row: channel_label(row["name"]),
    "unit": lambda row: row["unit"] or _UNITS.get(row["name"][:1] if len(row["name"]) == 2 else "", ""),
    "RMSE nominal": "reference_rmse",
    "RMSE identified": "rmse",
    "change": lambda row: _relative_change(row["reference_rmse"], row["rmse"]),
    "correlation nominal": "reference_cc",
    "correlation identified": "cc",
}


def _relative_change(before: float | None, after: float | None) -> str:
    if not before or after is None:
        return "–"
    return f"{100.0 * (after - before) / before:+.0f} %".replace("-", "−")


# The report's section on a person: segment masses beside the tables', and the ground reaction.

_ROLES = {"validation": "trials that were left out", "identification": "trials that were identified from"}


@section("person", "Person")
def show_person(findings: Findings) -> Content | str:
    """De Leva's and Dumas' masses beside those that were identified, and how well the ground reaction is predicted."""
    human = findings.human
    if human is None:
        return ""
    lead = (
        "Masses of the segments by two tables of the literature, beside those that the ground reaction tells; "
        "± is one standard deviation of motions and table together, and where it is as large as the mass, motions "
        "did not tell it."
    )
    return section_content(lead, _mass_table(human, findings), _reaction_table(human))


def _mass_table(human: Document, findings: Findings) -> str:
    found = (findings.identification or {}).get("standard_parameters", {}).values()
    blocks = {block.get("name"): block for block in reversed(found) if block["nominal_mass"]}
    columns: dict[str, Any] = {
        "segment": "segment",
        "de Leva 1996 [kg]": "de_leva_kg",
        "Dumas 2007 [kg]": "dumas_kg",
    }
    if found:
        columns["identified [kg]"] = lambda item: _with_deviation(blocks.get(item["segment"]))
    return columns_table(human["segments"], columns)


def _with_deviation(block: Document | None) -> str:
    if block is None:
        return "–"
    std = (block.get("std") or {}).get("mass")
    return format_number(block["mass"]) + ("" if std is None else f" ± {format_number(std, 2)}")


_REACTIONS: Columns = {
    "ground reaction": lambda fit: f"{fit['name']} [{fit['unit']}]",
    "RMSE identified": "rmse",
    "correlation": lambda fit: format_number(fit["cc"]),
    "RMSE nominal": "reference_rmse",
    "correlation nominal": lambda fit: format_number(fit["reference_cc"]),
}


def _reaction_table(human: Document) -> str:
    fits = human.get("ground_reaction") or {}
    return "".join(
        f"<h3>Ground reaction, {words}</h3>{columns_table(named_rows(fits[role]), _REACTIONS)}"
        for role, words in _ROLES.items()
        if fits.get(role)
    )


# What several sessions of one robot agree on, and what changes between them.

# Sessions that have a column of their own in the table.
_COLUMNS = 6


@section("sessions", "Sessions")
def show_sessions(findings: Findings) -> Content | str:
    """Parameters that vary between sessions beyond their intervals in the open, all others behind a fold."""
    found = (findings.identification or {}).get("sessions")
    if not found:
        return ""
    varying = [item for item in found["parameters"] if item["varies"]]
    count = f"{len(varying)} of {len(found['parameters'])}" if varying else "None"
    lead = (
        f"{count} of the base parameters differ{'s' if len(varying) == 1 else ''} between {len(found['names'])} "
        f"sessions ({', '.join(found['names'][:_COLUMNS])}) by more than their own intervals allow: friction that "
        "warms up, a load, a zero that was set anew."
    )
    if not varying:
        lead = lead.partition(":")[0] + "."
    notes = [
        html_paragraph(f"Left out: {name}, whose motions determine {own} of them.", "note")
        for name, own in found["left_out"].items()
    ]
    rest = [item for item in found["parameters"] if not item["varies"]]
    shown = [_sessions_table(varying, found)] if varying else []
    return section_content(
        lead,
        *notes,
        *shown,
        html_paragraph("ranges.yaml holds what the next session may bring, for domain randomisation."),
        folded_content(f"{len(rest)} that sessions agree on", _sessions_table(rest, found)) if rest else "",
    )


def _sessions_table(parameters: list[Document], found: Document) -> str:
    columns: dict[str, Any] = {"base parameter (SI)": "name"}
    columns |= {name: partial(_session_value, name) for name in found["names"][:_COLUMNS]}
    level = f"the next lies in ({100 * found['level']:.0f} %)"
    columns[level] = lambda item: span(format_number(item["low"]), format_number(item["high"]))
    return columns_table(parameters, columns)


def _session_value(name: str, item: Document) -> str:
    found = item["by_session"].get(name)
    return "–" if found is None else f"{format_number(found['value'])} ± {format_number(found['std'], 2)}"


# What the signal processing did to one channel.


@section("signals", "Signals")
def show_signals(findings: Findings) -> Content | str:
    """One panel and one line a step."""
    if findings.signals is None:
        return ""
    trace = trace_from_json(findings.signals)
    lead = (
        f"From the samples of {trace.channel} in {trace.trial}, as logged, to the rows of the regression: "
        "each panel is one step."
    )
    rows = [(f"{number} {step.name}", step.effect) for number, step in enumerate(trace.steps, start=1)]
    svg = to_svg(plot_signals(trace), "signals", "Each step of the signal processing, before and after")
    return section_content(lead, inline_figure(svg), html_table(("step", "what it did"), rows))


# The base parameters, whether the standard ones are physical, and warnings.

_CHECKS = {
    "mass_positive": "masses are positive",
    "inertia_positive_definite": "inertias are positive definite",
    "triangle_inequality": "inertias obey the triangle inequality",
    "pseudo_inertia_min_eigenvalue": "smallest eigenvalue of a pseudo-inertia",
}

_BASE_PARAMETERS: Columns = {
    "base parameter (SI)": "expression",
    "value": "value",
    "standard deviation": "std",
    "RSD": lambda item: Said(item["rsd_percent"], said_rsd(item["rsd_percent"])),
}


@section("parameters", "Parameters")
def show_parameters(findings: Findings) -> Content | str:
    """Values with their uncertainty, behind a fold; warnings in the open."""
    identification = findings.identification
    if identification is None:
        return ""
    lead = (
        f"Identified with method {identification['method']} from {identification['n_samples']} samples; "
        "a relative standard deviation (RSD) above 10 to 20 % means that the data hardly determine it."
    )
    warnings = [html_paragraph(text, "note") for text in identification["warnings"]]
    base = identification["base_parameters"]
    values = folded_content(f"{len(base)} base parameters", columns_table(base, _BASE_PARAMETERS))
    return section_content(lead, *warnings, _consistency_sentence(identification), values)


def _consistency_sentence(identification: dict) -> str:
    found = identification["consistency"] or {}
    rows = [(label, found[name]) for name, label in _CHECKS.items() if found.get(name) is not None]
    return html_table(("physical consistency of the standard parameters", ""), rows) if rows else ""
