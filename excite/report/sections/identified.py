"""Sections of an identification: segment masses, prediction of the sensors, signal processing, sessions."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.atomic import atomic_path
from excite.display import span
from excite.logs.signals.trace import SignalTrace, trace_from_json
from excite.report.comparisons import ForceComparison, MassComparison, ReportData
from excite.report.folder import Document, Findings
from excite.report.html import (
    Cell,
    folded_content,
    format_number,
    html_paragraph,
    html_table,
    inline_figure,
    live_chart,
)
from excite.report.plots.forces import MOST_PANELS, channel_label, plot_forces
from excite.report.sections.section import Content, section, section_content
from excite.report.theme import (
    IDENTIFIED,
    INK,
    NOMINAL,
    PALE,
    TRUE,
    draw_figure,
    shorten_name,
    to_png,
    to_svg,
)

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
    svg = to_svg(plot_masses(data), "masses", "Mass of each segment: nominal, identified, true")
    return section_content(
        lead,
        inline_figure(svg),
        folded_content("Numbers", _mass_numbers(data)),
    )


def _mass_numbers(data: MassComparison) -> str:
    columns = {"nominal [kg]": data.nominal, "identified [kg]": data.identified}
    sums = {name: float(np.sum(column)) for name, column in columns.items()}
    if data.half_width is not None:
        columns["± 95 % [kg]"] = data.half_width
    if data.determined is not None:
        columns["told by the data [%]"] = 100.0 * data.determined
    if data.true is not None:
        columns["true [kg]"] = data.true
        sums["true [kg]"] = float(np.sum(data.true))
    rows: list[tuple[Cell, ...]] = [
        (name, *(float(column[i]) for column in columns.values())) for i, name in enumerate(data.names)
    ]
    # Masses of neighbours are known together, so that their intervals do not add up.
    return html_table(["segment", *columns], rows, ("all", *(sums.get(name, "") for name in columns)))


# Masses of the segments: nominal, identified, true.


def plot_masses(data: MassComparison) -> Figure:
    """One row a segment: pale bar nominal, strong bar identified, its interval, tick true; changed ones in bold."""

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        rows = np.arange(len(data.names))
        style: dict[str, Any]
        axes.barh(rows, data.nominal, height=0.74, color=PALE.light, label="nominal")
        axes.barh(rows, data.identified, height=0.36, color=IDENTIFIED.light, label="identified")
        if data.half_width is not None:
            style = {"ecolor": INK.light, "elinewidth": 1.1, "fmt": "none"}
            axes.errorbar(data.identified, rows, xerr=data.half_width, label="95 %", **style)
        if data.true is not None:
            style = {
                "marker": "|",
                "markersize": 11,
                "markeredgewidth": 2.2,
                "linestyle": "none",
            }
            axes.plot(data.true, rows, color=TRUE.light, label="true", **style)
        axes.set(ylim=(len(rows) - 0.4, -0.6), xlabel="mass [kg]")
        if data.half_width is None:
            axes.set_xlim(left=min(0.0, float(np.min(data.identified))))
        axes.set_yticks(rows, [shorten_name(name) for name in data.names])
        axes.tick_params(axis="y", length=0)
        if data.changed is not None:
            for label, changed in zip(axes.get_yticklabels(), data.changed, strict=True):
                if changed:
                    label.set(fontweight="bold", color=INK.light)
        axes.grid(axis="y", visible=False)
        handles = dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True))
        order = [name for name in ("nominal", "identified", "95 %", "true") if name in handles]
        figure.legend([handles[name] for name in order], order, loc="outside upper left", ncols=4)

    return draw_figure(paint, height_in=1.0 + 0.21 * len(data.names))


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
    with atomic_path(Path(path)) as temporary:
        temporary.write_bytes(to_png(plot_signals(trace)))
    return Path(path)


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
    tables = [f"<h3>{title}</h3>{_fit_table(rows)}" for title, rows in blocks if rows]
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
        svg = to_svg(plot_forces(data), "forces", "Measured and predicted forces of a validation trial")
        content.append(live_chart("forces-plots", data.time, list(_force_panels(data)), inline_figure(svg)))
    return section_content(lead, *content, *tables)


def _from_zero(data: ReportData) -> ForceComparison | None:
    """The curves with the trial's own time, by which it is shown in motion; a record's clock may start anywhere."""
    forces, path = data.forces, data.path
    if forces is None:
        return None
    same = path is not None and path.trial == forces.trial
    return replace(forces, time=forces.time - (path.time[0] if path is not None and same else forces.time[0]))


def _force_panels(data: ForceComparison) -> Iterator[dict[str, Any]]:
    for i, name in enumerate(data.channels[:MOST_PANELS]):
        series = [
            ({"label": "measured", "role": "ink"}, data.measured[:, i]),
            ({"label": "nominal model", "role": "nominal", "dash": [5, 3]}, data.nominal[:, i]),
            ({"label": "identified model", "role": "identified"}, data.identified[:, i]),
        ]
        unit = data.units[i]
        yield {"title": f"{channel_label(name)} [{unit}]", "unit": unit, "series": series}


def _fit_table(channels: dict[str, dict[str, Any]]) -> str:
    rows: list[tuple[Cell, ...]] = []
    for channel, row in channels.items():
        before, after = row["reference_rmse"], row["rmse"]
        known = bool(before) and after is not None
        change = f"{100.0 * (after - before) / before:+.0f} %".replace("-", "−") if known else "–"
        unit = row["unit"] or _UNITS.get(channel[:1] if len(channel) == 2 else "", "")
        rows.append((channel_label(channel), unit, before, after, change, row["reference_cc"], row["cc"]))
    headers = (
        "channel",
        "unit",
        "RMSE nominal",
        "RMSE identified",
        "change",
        "correlation nominal",
        "correlation identified",
    )
    return html_table(headers, rows)


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
    found = (findings.identification or {}).get("standard_parameters", {})
    headers = ["segment", "de Leva 1996 [kg]", "Dumas 2007 [kg]"] + (["identified [kg]"] if found else [])
    rows: list[tuple[Cell, ...]] = []
    for item in human["segments"]:
        row: tuple[Cell, ...] = (item["segment"], item["de_leva_kg"], item["dumas_kg"])
        block = next(
            (
                block
                for block in found.values()
                if block.get("name") == item["segment"] and block["nominal_mass"]
            ),
            None,
        )
        if found:
            row = (*row, "–" if block is None else _with_deviation(block))
        rows.append(row)
    return html_table(headers, rows)


def _with_deviation(block: Document) -> str:
    std = (block.get("std") or {}).get("mass")
    return format_number(block["mass"]) + ("" if std is None else f" ± {format_number(std, 2)}")


def _reaction_table(human: Document) -> str:
    parts = []
    for role, words in _ROLES.items():
        fits = (human.get("ground_reaction") or {}).get(role)
        if not fits:
            continue
        rows: list[tuple[Cell, ...]] = [
            (
                f"{name} [{fit['unit']}]",
                fit["rmse"],
                format_number(fit["cc"]),
                fit["reference_rmse"],
                format_number(fit["reference_cc"]),
            )
            for name, fit in fits.items()
        ]
        headers = ["ground reaction", "RMSE identified", "correlation", "RMSE nominal", "correlation"]
        parts.append(f"<h3>Ground reaction, {words}</h3>" + html_table(headers, rows))
    return "".join(parts)


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
    names = found["names"][:_COLUMNS]
    rows: list[tuple[Cell, ...]] = [
        (
            item["name"],
            *(_session_value(item["by_session"].get(name)) for name in names),
            span(format_number(item["low"]), format_number(item["high"])),
        )
        for item in parameters
    ]
    level = f"the next lies in ({100 * found['level']:.0f} %)"
    return html_table(("base parameter (SI)", *names, level), rows)


def _session_value(found: Document | None) -> str:
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
    rows: list[tuple[Cell, ...]] = [
        (f"{number} {step.name}", step.effect) for number, step in enumerate(trace.steps, start=1)
    ]
    svg = to_svg(plot_signals(trace), "signals", "Each step of the signal processing, before and after")
    return section_content(lead, inline_figure(svg), html_table(("step", "what it did"), rows))
