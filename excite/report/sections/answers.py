"""The first sections of a report: the answer, key figures, parameters and their certainty."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from excite.display import count
from excite.export.models.parameters import find_differences
from excite.identification.judgement.judgement import said_rsd
from excite.report.conclusions import Conclusion, draw_conclusion
from excite.report.folder import Findings, Origin
from excite.report.html import (
    Columns,
    Said,
    columns_table,
    condition_value,
    folded_content,
    format_number,
    html_paragraph,
    html_table,
    inline_figure,
    key_figure,
)
from excite.report.sections.section import Content, section, section_content
from excite.report.theme import IDENTIFIED, INK, NOMINAL, draw_figure, to_svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# What was found, whether it is good enough, and what to do next: the first thing on the page.


@section("answer")
def show_answer(findings: Findings) -> Content | str:
    """One sentence, the next command, and which command made what the page shows."""
    answer = draw_conclusion(findings)
    if answer is None:
        return ""
    mark = {True: " yes", False: " no", None: ""}[answer.good]
    said = html_paragraph(answer.found, "verdict")
    return (
        f'<section id="answer" '
        f'class="answer{mark}">{said}{_next_step(answer)}{_made_files(findings)}</section>'
    )


def _next_step(answer: Conclusion) -> str:
    if not answer.command:
        return f'<p class="next">Next: {escape(answer.purpose)}</p>' if answer.purpose else ""
    line = " ".join(["excite", *(shlex.quote(str(word)) for word in answer.command)])
    return f'<p class="next">Next: <code>{escape(line)}</code> · {escape(answer.purpose)}</p>'


def _made_files(findings: Findings) -> str:
    """A line a command, with all that it wrote."""
    by: dict[Origin, list[str]] = {}
    for name, made in findings.made.items():
        by.setdefault(made, []).append(f"{name}.json")
    return "".join(f'<p class="made">{_command_line(names, made)}</p>' for made, names in by.items())


def _command_line(names: list[str], made: Origin) -> str:
    listed = " and ".join([*([", ".join(names[:-1])] if names[1:] else []), names[-1]])
    if not made.command:
        return f"{listed} written {made.written}"
    command = f"<code>{escape(made.command)}</code>, excite {escape(made.version)}, seed {made.seed}"
    return f"{listed} made by {command}, {made.written}"


# Relative standard deviations of the base parameters, iteration by iteration.


def plot_rsd(iterations: Sequence[dict], target_percent: float | None = None) -> Figure:
    """A column of points an iteration: dots meet their target, crosses do not; the bar is the median.

    Args:
        iterations: the campaign file's ``iterations``.
        target_percent: drawn as a line where given [%].
    """

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        for x, iteration in enumerate(iterations):
            _draw_column(axes, x, iteration)
        if target_percent is not None:
            axes.axhline(target_percent, color=INK.light, lw=0.9, ls=(0, (5, 3)))
            label = f"target {target_percent:g} %"
            axes.text(
                1.0, target_percent, label, transform=axes.get_yaxis_transform(), va="bottom", ha="right"
            )
        axes.set(yscale="log", ylabel="relative standard deviation [%]", xlim=(-0.6, len(iterations) - 0.4))
        labels = [
            f"iteration {i}\n{count(step.get('n_motions', 0), 'motion')}\n"
            f"{_n_met(step)} of {len({*step['rsd_percent'], *step.get('not_met', ())})} parameters meet it"
            for i, step in enumerate(iterations, start=1)
        ]
        axes.set_xticks(range(len(iterations)), labels)
        axes.grid(axis="x", visible=False)
        handles, names = axes.get_legend_handles_labels()
        unique = dict(zip(names, handles, strict=True))
        figure.legend(list(unique.values()), list(unique), loc="outside upper left", ncols=3)

    return draw_figure(paint, height_in=3.6)


def _n_met(iteration: dict) -> int:
    missed = set(iteration.get("not_met", ()))
    return sum(name not in missed for name in iteration["rsd_percent"])


def _draw_column(axes: Axes, x: int, iteration: dict) -> None:
    missed = set(iteration.get("not_met", ()))
    names = sorted(
        iteration["rsd_percent"], key=lambda name: (iteration["rsd_percent"][name] or np.inf, name)
    )
    values = np.array([iteration["rsd_percent"][name] or np.nan for name in names], dtype=float)
    met = np.array([name not in missed for name in names])
    # Points that lie close in value are spread sideways by their rank: the golden ratio never aligns them.
    spread = 0.56 * ((np.arange(len(names)) * 0.6180339887498949) % 1.0 - 0.5)
    for which, marker, color, label in (
        (met, "o", IDENTIFIED.light, "meets the target"),
        (~met, "x", NOMINAL.light, "does not"),
    ):
        axes.plot(
            x + spread[which], values[which], marker, ms=3.6, mew=1.0, color=color, label=label, alpha=0.75
        )
    if np.isfinite(values).any():
        axes.plot([x - 0.34, x + 0.34], [np.nanmedian(values)] * 2, color=INK.light, lw=2.0, label="median")


# How certain the base parameters became, iteration by iteration.


@section("certainty", "Certainty")
def show_certainty(findings: Findings) -> Content | str:
    """Relative standard deviations per iteration, and which parameters miss the target."""
    if findings.campaign is None or not findings.campaign["iterations"]:
        return ""
    campaign = findings.campaign
    iterations = campaign["iterations"]
    target = campaign["target_rsd_percent"]
    lead = (
        "Each point is one base parameter: with every iteration the points should sink, and those that "
        "stay above their target are the ones that new motions are made for, where more motion can help."
    )
    plot = plot_rsd(iterations, target)
    last = iterations[-1]
    missed = sorted(last["not_met"], key=lambda name: -(last["rsd_percent"].get(name) or float("inf")))
    why = last["reasons"] or {}
    deviations = [last["rsd_percent"].get(name) for name in missed]
    rows = [
        (name, Said(rsd, said_rsd(rsd)), why.get(name, ""))
        for name, rsd in zip(missed, deviations, strict=True)
    ]
    listing = folded_content(
        f"{count(len(missed), 'parameter')} above the target at the end",
        html_table(("base parameter", "RSD", "why"), rows),
    )
    svg = to_svg(plot, "rsd", "Relative standard deviation of each base parameter per iteration")
    return section_content(lead, inline_figure(svg), listing if missed else "")


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


@section("differences", "Differences")
def show_differences(findings: Findings) -> Content | str:
    """Parameters that clearly changed in the open, all of them behind a fold."""
    identification = findings.identification or {}
    found = find_differences(identification.get("standard_parameters") or {})
    if not found.rows:
        return ""
    clear = [row for row in found.rows if row.clear]
    lead = (
        "Inertial parameters about the joint frames (SI), as supplied and as identified, with one standard "
        "deviation. Where little comes from data the value is the nominal model's and the constraints' "
        "choice: the motions, or the robot's joints, do not tell it from its neighbours'."
    )
    everything = folded_content(f"All {len(found.rows)} parameters", columns_table(found.rows, _DIFFERENCES))
    if not clear:
        said = "No single parameter is determined by the data and more than two deviations off."
        return section_content(lead, html_paragraph(said), everything)
    said = (
        f"{len(clear)} of {len(found.rows)} were determined mostly by the data and moved by more than "
        "two standard deviations:"
    )
    strongest = sorted(clear, key=lambda row: -abs(row.change) / max(row.std or 0.0, 1e-300))[:20]
    chosen = [row for row in found.rows if row in strongest]
    return section_content(lead, html_paragraph(said), columns_table(chosen, _DIFFERENCES), everything)


# The figures that say at a glance how it went.

# A segment of whose mass the data tell less is as the nominal model has it.
_TOLD = 0.5


@section("overview")
def show_overview(findings: Findings) -> Content | str:
    """A row of key figures, each only where the folder holds it."""
    tiles = [*_plan_tiles(findings), *_check_tiles(findings), *_conditioning_tiles(findings)]
    tiles += [*_certainty_tiles(findings), *_fit_tiles(findings), *_mass_tiles(findings)]
    return f'<div class="tiles" id="overview">{"".join(tiles)}</div>' if tiles else ""


def _plan_tiles(findings: Findings) -> Iterator[str]:
    if findings.plan is None:
        return
    candidates = findings.plan["candidates"]
    yield key_figure(f"{candidates['accepted']} of {candidates['generated']}", "candidate motions accepted")
    selected = findings.plan["selected"]
    seconds = sum(entry["duration_s"] for entry in selected)
    yield key_figure(count(len(selected), "motion"), f"chosen, {seconds:.0f} s in all")


def _check_tiles(findings: Findings) -> Iterator[str]:
    if findings.check is not None:
        motions = findings.check["motions"]
        n_safe = sum(motion["safe"] for motion in motions)
        yield key_figure(
            f"{n_safe} of {len(motions)}", "motions pass the independent check", good=n_safe == len(motions)
        )


def _conditioning_tiles(findings: Findings) -> Iterator[str]:
    change = findings.data.conditioning
    planned = (findings.plan or {}).get("conditioning")
    if change is not None and change.full_after == change.full_before:
        label = (
            f"condition number of the base columns, of {change.before_label} and {change.after_label} alike"
        )
        yield key_figure(format_number(change.full_after), label)
    elif change is not None:
        label = f"condition number of the base columns: {change.before_label} → {change.after_label}"
        if change.full_after > change.full_before:
            # Motions are chosen for single segments: the whole may come out a little worse.
            better = int((change.after < change.before).sum())
            label += (
                f"; they are chosen by segment, and {better} of {len(change.after)} segments are better so"
            )
        yield key_figure(f"{format_number(change.full_before)} → {format_number(change.full_after)}", label)
    elif planned is not None:
        yield key_figure(
            format_number(condition_value(planned["full"])), "condition number of the base columns"
        )


def _certainty_tiles(findings: Findings) -> Iterator[str]:
    if findings.campaign is not None and findings.campaign["iterations"]:
        last = findings.campaign["iterations"][-1]
        judged = {*last["rsd_percent"], *last["not_met"]}
        n = len(judged)
        label = "parameters meet their certainty target"
        yield key_figure(f"{n - len(last['not_met'])} of {n}", label, good=findings.campaign["targets_met"])


def _fit_tiles(findings: Findings) -> Iterator[str]:
    channels = (findings.identification or {}).get("validation") or {}
    judged = [row for row in channels.values() if None not in (row["reference_rmse"], row["rmse"])]
    if judged:
        better = sum(row["rmse"] < row["reference_rmse"] for row in judged)
        label = "validation channels are predicted better than by the nominal model"
        yield key_figure(f"{better} of {len(judged)}", label, good=better == len(judged))


def _mass_tiles(findings: Findings) -> Iterator[str]:
    masses = findings.data.masses
    if masses is None:
        return
    total = float(masses.identified.sum())
    if masses.true is None or not masses.true.sum():
        label = f"total mass of the identified model; nominal {masses.nominal.sum():.2f} kg"
        if masses.determined is not None and masses.determined.min() < _TOLD:
            label += "; not all of it is told by the data, see Masses"
        yield key_figure(f"{total:.2f} kg", label)
        return
    true = float(masses.true.sum())
    label = f"total mass identified; true {true:.2f} kg, nominal {masses.nominal.sum():.2f} kg"
    off = f"{100.0 * (total - true) / true:+.2f} %".replace("+0.00", "0.00").replace("-0.00", "0.00")
    yield key_figure(f"{total:.2f} kg", f"{label} ({off})".replace("-", "−"))


# How long each stage of the plan took.


@section("stages", "Time taken")
def show_stages(findings: Findings) -> Content | str:
    """Seconds by stage."""
    stages = (findings.plan or {}).get("stages")
    if not stages:
        return ""
    columns: Columns = {"stage": "stage", "time [s]": lambda one: round(float(one["seconds"]), 2)}
    total = ("all", sum(float(entry["seconds"]) for entry in stages))
    lead = "The plan's stages in the order in which they ran."
    return section_content(lead, columns_table(stages, columns, total))
