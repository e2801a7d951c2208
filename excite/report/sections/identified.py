"""Sections of an identification: masses, prediction of the sensors, parameters and their certainty, sessions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.display import count, span
from excite.export.models.parameters import find_differences
from excite.identification.judgement import said_rsd
from excite.report.comparisons import MassComparison
from excite.report.folder import Document, Findings
from excite.report.html import (
    Columns,
    Said,
    Shown,
    columns_table,
    folded_content,
    format_number,
    html_paragraph,
    html_table,
    inline_figure,
    named_rows,
)
from excite.report.plots.curves import (
    MOST_PANELS,
    Bars,
    channel_label,
    channel_panels,
    draw_bars,
    show_panels,
)
from excite.report.theme import IDENTIFIED, INK, NOMINAL, draw_figure, to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Masses of the segments.


def show_masses(findings: Findings) -> Shown:
    """Nominal, identified and, on a virtual robot, true masses."""
    data = findings.data.masses
    if data is None:
        return ""
    truth = "; the green tick is the truth, which only a virtual robot tells" if data.true is not None else ""
    lead = f"Where the blue bar leaves the pale one, the robot is not the model that was supplied{truth}."
    if data.half_width is not None:
        lead += (
            " Lines are 95 % intervals of the data and of what the nominal model is granted together: where the "
            "data tell little of a mass by itself, as of neighbours whose sum they tell, it is as wide as that."
        )
    names = _changed_names(data)
    if names:
        lead += (
            " In bold, the fewest segments that, changed in mass, centre of mass or inertia, explain what the "
            f"nominal model leaves: {', '.join(names)}. A robot whose bodies all differ a little shows itself so "
            "too; Differences lists what the data tell of each parameter by itself."
        )
    told = None if data.determined is None else 100.0 * data.determined
    columns = {
        "nominal [kg]": data.nominal,
        "identified [kg]": data.identified,
        "± 95 % [kg]": data.half_width,
        "told by the data [%]": told,
        "true [kg]": data.true,
    }
    known = {name: column for name, column in columns.items() if column is not None}
    rows = [(name, *map(float, row)) for name, *row in zip(data.names, *known.values(), strict=True)]
    # Masses of neighbours are known together, so that their intervals do not add up.
    single = {"± 95 % [kg]", "told by the data [%]"}
    sums = ("" if name in single else float(np.sum(column)) for name, column in known.items())
    numbers = html_table(["segment", *known], rows, ("all", *sums))
    svg = to_svg(draw_masses(data), "masses-bars", "Mass of each segment: nominal, identified, true")
    return [lead, inline_figure(svg), folded_content("Numbers", numbers)]


def _changed_names(data: MassComparison) -> list[str]:
    return [] if data.changed is None else list(np.array(data.names)[data.changed])


def draw_masses(data: MassComparison) -> Figure:
    """One row a segment: pale bar nominal, strong bar identified, its interval, tick true; changed ones in bold."""
    return draw_bars(
        Bars(
            data.names,
            data.nominal,
            data.identified,
            ("nominal", "identified", "95 %", "true"),
            "mass [kg]",
            half_width=data.half_width,
            ticks=data.true,
            bold=_changed_names(data),
        )
    )


# How well the models predict what the sensors measured.

# Of wrenches in documents that do not say it.
_UNITS = {f"{letter}{axis}": unit for letter, unit in (("f", "N"), ("t", "N·m")) for axis in "xyz"}
_FITS: Columns = {
    "channel": lambda row: channel_label(row["name"]),
    "unit": lambda row: row["unit"] or _UNITS.get(row["name"], ""),
    "RMSE nominal": "reference_rmse",
    "RMSE identified": "rmse",
    "change": lambda row: _relative_change(row["reference_rmse"], row["rmse"]),
    "correlation nominal": "reference_cc",
    "correlation identified": "cc",
}


def show_forces(findings: Findings) -> Shown:
    """Measured, nominal and identified on one trial; RMSE and correlation of all trials."""
    data, record, found = findings.data.forces, findings.record, findings.identification or {}
    blocks = {
        "Cross validation (trials that the identification has not seen)": found.get("validation"),
        "Direct validation (trials that it was identified from)": found.get("fit"),
    }
    tables = [
        f"<h3>{title}</h3>{columns_table(named_rows(rows), _FITS)}" for title, rows in blocks.items() if rows
    ]
    if data is None:
        lead = "RMSE should fall and correlation rise from the nominal to the identified model."
        return [lead, *tables] if tables else ""
    # The trial's own time, by which it is shown in motion; a record's clock may start anywhere.
    trial = None if record is None else record.trial(data.trial)
    same = trial is not None and trial.name == data.trial
    data = replace(data, time=data.time - (trial.time[0] if trial is not None and same else data.time[0]))
    lead = (
        f"On {data.trial}, which the identification has not seen, the blue line of the identified "
        "model should cover the measured one, and the dashed nominal one should not."
    )
    if len(data.channels) > MOST_PANELS:
        lead += f" Drawn are the first {MOST_PANELS} of {len(data.channels)} channels."
    said = "Measured and predicted forces of a validation trial"
    return [lead, show_panels("forces", data.time, channel_panels(data), said), *tables]


def _relative_change(before: float | None, after: float | None) -> str:
    if not before or after is None:
        return "–"
    return f"{100.0 * (after - before) / before:+.0f} %".replace("-", "−")


# A person: segment masses by the tables.


def show_person(findings: Findings) -> Shown:
    """De Leva's and Dumas' masses of the segments."""
    human = findings.human
    if human is None:
        return ""
    columns = {"segment": "segment", "de Leva 1996 [kg]": "de_leva_kg", "Dumas 2007 [kg]": "dumas_kg"}
    return [
        "Masses of the segments by two tables of the literature.",
        columns_table(human["segments"], columns),
    ]


# What several sessions of one robot agree on, and what changes between them.

# Sessions that have a column of their own in the table.
_COLUMNS = 6


def show_sessions(findings: Findings) -> Shown:
    """Parameters that vary between sessions beyond their intervals in the open, all others behind a fold."""
    found = (findings.identification or {}).get("sessions")
    if not found:
        return ""
    varying, rest = (
        [item for item in found["parameters"] if item["varies"] is flag] for flag in (True, False)
    )
    many = f"{len(varying)} of {len(found['parameters'])}" if varying else "None"
    why = ": friction that warms up, a load, a zero that was set anew" if varying else ""
    lead = (
        f"{many} of the base parameters differ{'s' if len(varying) == 1 else ''} between {len(found['names'])} "
        f"sessions ({', '.join(found['names'][:_COLUMNS])}) by more than their own intervals allow{why}."
    )
    columns: dict[str, Any] = {"base parameter (SI)": "name"}
    for name in found["names"][:_COLUMNS]:
        columns[name] = lambda item, name=name: _session_value(item["by_session"].get(name))
    columns[f"the next lies in ({100 * found['level']:.0f} %)"] = lambda item: span(
        format_number(item["low"]), format_number(item["high"])
    )
    return [
        lead,
        *(
            html_paragraph(f"Left out: {name}, whose motions determine {own} of them.", "note")
            for name, own in found["left_out"].items()
        ),
        columns_table(varying, columns) if varying else "",
        html_paragraph("ranges.yaml holds what the next session may bring, for domain randomisation."),
        folded_content(f"{len(rest)} that sessions agree on", columns_table(rest, columns)) if rest else "",
    ]


def _session_value(found: Document | None) -> str:
    return "–" if found is None else f"{format_number(found['value'])} ± {format_number(found['std'], 2)}"


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


def show_parameters(findings: Findings) -> Shown:
    """Values with their uncertainty, behind a fold; warnings in the open."""
    found = findings.identification
    if found is None:
        return ""
    base, consistency = found["base_parameters"], found["consistency"] or {}
    rows = [
        (label, consistency[name]) for name, label in _CHECKS.items() if consistency.get(name) is not None
    ]
    return [
        f"Identified with method {found['method']} from {found['n_samples']} samples; "
        "a relative standard deviation (RSD) above 10 to 20 % means that the data hardly determine it.",
        *(html_paragraph(text, "note") for text in found["warnings"]),
        html_table(("physical consistency of the standard parameters", ""), rows) if rows else "",
        folded_content(f"{len(base)} base parameters", columns_table(base, _BASE_PARAMETERS)),
    ]


# How certain the base parameters became, iteration by iteration.


def plot_rsd(iterations: Sequence[Document], target_percent: float | None = None) -> Figure:
    """A column of points an iteration: dots meet their target, crosses do not; the bar is the median.

    Args:
        iterations: the campaign file's ``iterations``.
        target_percent: drawn as a line where given [%].
    """

    def paint_points(figure: Figure) -> None:
        axes, labels = figure.subplots(), []
        for x, step in enumerate(iterations):
            rsd, missed = step["rsd_percent"], set(step.get("not_met", ()))
            ordered = sorted(rsd.items(), key=lambda item: (item[1] or np.inf, item[0]))
            values = np.array([value or np.nan for _, value in ordered], dtype=float)
            met = np.array([name not in missed for name, _ in ordered], dtype=bool)
            # Points that lie close in value are spread sideways by their rank: the golden ratio never aligns them.
            at = x + 0.56 * ((np.arange(len(ordered)) * 0.6180339887498949) % 1.0 - 0.5)
            for which, marker, role, label in (
                (met, "o", IDENTIFIED, "meets the target"),
                (~met, "x", NOMINAL, "does not"),
            ):
                look: dict[str, Any] = {"ms": 3.6, "mew": 1.0, "color": role.light, "alpha": 0.75}
                axes.plot(at[which], values[which], marker, label=label, **look)
            if np.isfinite(values).any():
                axes.plot(
                    [x - 0.34, x + 0.34], [np.nanmedian(values)] * 2, color=INK.light, lw=2.0, label="median"
                )
            labels.append(
                f"iteration {x + 1}\n{count(step.get('n_motions', 0), 'motion')}\n"
                f"{int(met.sum())} of {len({*rsd, *missed})} parameters meet it"
            )
        if target_percent is not None:
            axes.axhline(target_percent, color=INK.light, lw=0.9, ls=(0, (5, 3)))
            place: dict[str, Any] = {"transform": axes.get_yaxis_transform(), "va": "bottom", "ha": "right"}
            axes.text(1.0, target_percent, f"target {target_percent:g} %", **place)
        axes.set(yscale="log", ylabel="relative standard deviation [%]", xlim=(-0.6, len(iterations) - 0.4))
        axes.set_xticks(range(len(iterations)), labels)
        axes.grid(axis="x", visible=False)
        handles, names = axes.get_legend_handles_labels()
        unique = dict(zip(names, handles, strict=True))
        figure.legend(list(unique.values()), list(unique), loc="outside upper left", ncols=3)

    return draw_figure(paint_points, height_in=3.6)


def show_certainty(findings: Findings) -> Shown:
    """Relative standard deviations per iteration, and which parameters miss the target."""
    if findings.campaign is None or not findings.campaign["iterations"]:
        return ""
    iterations, target = findings.campaign["iterations"], findings.campaign["target_rsd_percent"]
    last = iterations[-1]
    rsd, why = last["rsd_percent"], last["reasons"] or {}
    missed = sorted(last["not_met"], key=lambda name: -(rsd.get(name) or np.inf))
    rows = [(name, Said(rsd.get(name), said_rsd(rsd.get(name))), why.get(name, "")) for name in missed]
    listing = html_table(("base parameter", "RSD", "why"), rows)
    said = "Relative standard deviation of each base parameter per iteration"
    return [
        "Each point is one base parameter: with every iteration the points should sink, and those that "
        "stay above their target are the ones that new motions are made for, where more motion can help.",
        inline_figure(to_svg(plot_rsd(iterations, target), "rsd", said)),
        folded_content(f"{count(len(missed), 'parameter')} above the target at the end", listing)
        if missed
        else "",
    ]


# The table nominal → identified.

_DIFFERENCES: Columns = {
    "link": lambda row: row.segment,
    "parameter": lambda row: f"{row.parameter} [{row.unit}]",
    "nominal": lambda row: row.nominal,
    "identified": lambda row: row.identified,
    "change": lambda row: row.change,
    "±": lambda row: row.std,
    "from data [%]": lambda row: None if row.determined is None else 100.0 * row.determined,
}


def show_differences(findings: Findings) -> Shown:
    """Parameters that clearly changed in the open, all of them behind a fold."""
    rows = find_differences((findings.identification or {}).get("standard_parameters") or {})
    if not rows:
        return ""
    clear = [row for row in rows if row.clear]
    said = (
        f"{len(clear)} of {len(rows)} were determined mostly by the data and moved by more than "
        "two standard deviations:"
        if clear
        else "No single parameter is determined by the data and more than two deviations off."
    )
    strongest = sorted(clear, key=lambda row: -abs(row.change) / max(row.std or 0.0, 1e-300))[:20]
    return [
        "Inertial parameters about the joint frames (SI), as supplied and as identified, with one standard "
        "deviation. Where little comes from data the value is the nominal model's and the constraints' "
        "choice: the motions, or the robot's joints, do not tell it from its neighbours'.",
        html_paragraph(said),
        columns_table([row for row in rows if row in strongest], _DIFFERENCES) if clear else "",
        folded_content(f"All {len(rows)} parameters", columns_table(rows, _DIFFERENCES)),
    ]
