"""The first sections of a report: the answer, key figures, parameters and their certainty."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.display import count
from excite.export.models.parameters import find_differences
from excite.identification.judgement.judgement import said_rsd
from excite.report.conclusions import draw_conclusion
from excite.report.folder import Document, Findings, Origin
from excite.report.html import (
    Columns,
    Said,
    Shown,
    columns_table,
    condition_value,
    folded_content,
    format_number,
    html_paragraph,
    html_table,
    inline_figure,
    key_figure,
)
from excite.report.theme import IDENTIFIED, INK, NOMINAL, draw_figure, to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# What was found, whether it is good enough, and what to do next: the first thing on the page.


def show_answer(findings: Findings) -> Shown:
    """One sentence, the next command, and a line a command with all that it wrote."""
    answer = draw_conclusion(findings)
    if answer is None:
        return ""
    line = " ".join(["excite", *(shlex.quote(str(word)) for word in answer.command)])
    command = f"<code>{escape(line)}</code> · " if answer.command else ""
    following = f'<p class="next">Next: {command}{escape(answer.purpose)}</p>' if answer.purpose else ""
    by: dict[Origin, list[str]] = {}
    for name, made in findings.made.items():
        by.setdefault(made, []).append(f"{name}.json")
    lines = "".join(f'<p class="made">{_command_line(names, made)}</p>' for made, names in by.items())
    mark = {True: " yes", False: " no", None: ""}[answer.good]
    said = html_paragraph(answer.found, "verdict")
    return f'<section id="answer" class="answer{mark}">{said}{following}{lines}</section>'


def _command_line(names: list[str], made: Origin) -> str:
    listed = " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
    if not made.command:
        return f"{listed} written {made.written}"
    command = f"<code>{escape(made.command)}</code>, excite {escape(made.version)}, seed {made.seed}"
    return f"{listed} made by {command}, {made.written}"


# How certain the base parameters became, iteration by iteration.


def plot_rsd(iterations: Sequence[Document], target_percent: float | None = None) -> Figure:
    """A column of points an iteration: dots meet their target, crosses do not; the bar is the median.

    Args:
        iterations: the campaign file's ``iterations``.
        target_percent: drawn as a line where given [%].
    """

    def paint(figure: Figure) -> None:
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

    return draw_figure(paint, height_in=3.6)


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
    rows = find_differences((findings.identification or {}).get("standard_parameters") or {}).rows
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


# The figures that say at a glance how it went.

# A segment of whose mass the data tell less is as the nominal model has it.
_TOLD = 0.5


def show_overview(findings: Findings) -> Shown:
    """A row of key figures, each only where the folder holds it."""
    tiles = "".join(_overview_tiles(findings))
    return f'<div class="tiles" id="overview">{tiles}</div>' if tiles else ""


def _overview_tiles(findings: Findings) -> Iterator[str]:
    plan, check, campaign = findings.plan, findings.check, findings.campaign
    if plan is not None:
        accepted, generated = plan["candidates"]["accepted"], plan["candidates"]["generated"]
        yield key_figure(f"{accepted} of {generated}", "candidate motions accepted")
        seconds = sum(entry["duration_s"] for entry in plan["selected"])
        yield key_figure(count(len(plan["selected"]), "motion"), f"chosen, {seconds:.0f} s in all")
    if check is not None:
        safe = [motion["safe"] for motion in check["motions"]]
        yield _share_figure(sum(safe), len(safe), "motions pass the independent check")
    yield from _conditioning_tiles(findings)
    if campaign is not None and campaign["iterations"]:
        last = campaign["iterations"][-1]
        n = len({*last["rsd_percent"], *last["not_met"]})
        met = n - len(last["not_met"])
        yield _share_figure(met, n, "parameters meet their certainty target", campaign["targets_met"])
    channels = ((findings.identification or {}).get("validation") or {}).values()
    better = [
        row["rmse"] < row["reference_rmse"]
        for row in channels
        if None not in (row["reference_rmse"], row["rmse"])
    ]
    if better:
        label = "validation channels are predicted better than by the nominal model"
        yield _share_figure(sum(better), len(better), label)
    yield from _mass_tiles(findings)


def _share_figure(n: int, of: int, label: str, good: bool | None = None) -> str:
    return key_figure(f"{n} of {of}", label, good=n == of if good is None else good)


def _conditioning_tiles(findings: Findings) -> Iterator[str]:
    change, planned = findings.data.conditioning, (findings.plan or {}).get("conditioning")
    what = "condition number of the base columns"
    if change is None:
        if planned is not None:
            yield key_figure(format_number(condition_value(planned["full"])), what)
        return
    before, after = change.full_before, change.full_after
    if after == before:
        label = f"{what}, of {change.before_label} and {change.after_label} alike"
        yield key_figure(format_number(after), label)
        return
    label = f"{what}: {change.before_label} → {change.after_label}"
    if after > before:
        # Motions are chosen for single segments: the whole may come out a little worse.
        better = int((change.after < change.before).sum())
        label += f"; they are chosen by segment, and {better} of {len(change.after)} segments are better so"
    yield key_figure(f"{format_number(before)} → {format_number(after)}", label)


def _mass_tiles(findings: Findings) -> Iterator[str]:
    masses = findings.data.masses
    if masses is None:
        return
    total, nominal = float(masses.identified.sum()), f"nominal {masses.nominal.sum():.2f} kg"
    true = 0.0 if masses.true is None else float(masses.true.sum())
    label = f"total mass of the identified model; {nominal}"
    if true:
        off = f"{100.0 * (total - true) / true:+.2f} %".replace("+0.00", "0.00").replace("-0.00", "0.00")
        label = f"total mass identified; true {true:.2f} kg, {nominal} ({off})".replace("-", "−")
    elif masses.determined is not None and masses.determined.min() < _TOLD:
        label += "; not all of it is told by the data, see Masses"
    yield key_figure(f"{total:.2f} kg", label)


# How long each stage of the plan took.


def show_stages(findings: Findings) -> Shown:
    """Seconds by stage."""
    stages = (findings.plan or {}).get("stages")
    if not stages:
        return ""
    columns: Columns = {"stage": "stage", "time [s]": lambda one: round(float(one["seconds"]), 2)}
    total = ("all", sum(float(entry["seconds"]) for entry in stages))
    return ["The plan's stages in the order in which they ran.", columns_table(stages, columns, total)]
