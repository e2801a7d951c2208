"""The report: one HTML file that needs no network."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path, PosixPath
from typing import TYPE_CHECKING, Any

from excite.arrays import Array
from excite.atomic import write_text
from excite.diagnosis.answer.gap import closed_in_words, of_positions
from excite.report.comparisons import ForceComparison
from excite.report.folder import Document, Findings, read_folder
from excite.report.html import (
    Cell,
    body_scripts,
    content_policy,
    format_number,
    html_paragraph,
    html_table,
    inline_figure,
    live_chart,
    plot_style,
)
from excite.report.plots.forces import channel_label
from excite.report.sections.answers import (
    show_answer,
    show_certainty,
    show_differences,
    show_overview,
    show_parameters,
)
from excite.report.sections.diagnosed import (
    show_baseline,
    show_budget_by_channel,
    show_gap_by_channel,
    show_log_findings,
    show_torques_beside_model,
    show_verdict,
    show_where,
)
from excite.report.sections.identified import (
    show_forces,
    show_masses,
    show_person,
    show_sessions,
    show_signals,
)
from excite.report.sections.motions import show_motions, show_moving
from excite.report.sections.planned import show_excitation, show_refused, show_safety
from excite.report.sections.section import Content, Section, section, section_content
from excite.report.theme import IDENTIFIED, INK, NOMINAL, css_variables, draw_figure, shorten_name, to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Headings of pages, by the document that a page is about, the last step first.
_TITLES = {
    "diagnosis": "Diagnosis of the gap",
    "campaign": "Campaign: excitation and identification",
    "identification": "Identification",
    "human": "A person's model",
    "plan": "Exciting motions",
    "refusals": "Exciting motions",
    "check": "Safety of motions",
    "doctor": "What is wrong with a log",
}


class Page(PosixPath):
    """Path of a page that was written; a notebook shows the page itself."""

    def _repr_html_(self) -> str:
        """The page in a frame, as it is on disk."""
        content = escape(self.read_text(encoding="utf-8"), quote=True)
        return f'<iframe srcdoc="{content}" style="width: 100%; height: 80vh; border: 0"></iframe>'


def report(folder: str | Path, out: str | Path | None = None) -> Page:
    """Write ``report.html`` from what a results folder holds; what it lacks is left out and said.

    Args:
        folder: the ``--out`` folder of another command.
        out: folder to write to; ``folder`` itself where left out.

    Returns:
        The path written, which a notebook shows as the page.

    Raises:
        InputError: no such folder, nothing in it to report on, or a file in it that is malformed.
    """
    return Page(write_text(Path(out or folder) / "report.html", render_page(read_folder(Path(folder)))))


def render_page(findings: Findings) -> str:
    """The page as text, the same bytes for the same findings."""
    built = [(part, part.build(findings)) for part in SECTIONS]
    shown = [(part, html) for part, html in built if html]
    links = "".join(
        f'<a href="#{part.identifier}">{escape(part.title)}</a>' for part, _ in shown if part.title
    )
    robot = robot_title(findings)
    what = next((title for name, title in _TITLES.items() if getattr(findings, name) is not None), "Results")
    title = f"{robot}: {what[0].lower()}{what[1:]}"
    body = (
        f"<header><p>{what}</p><h1>{escape(robot)}</h1><nav>{links}</nav></header>\n"
        f"<main>{''.join(html for _, html in shown)}</main>\n{_page_footer(findings)}\n"
    )
    return html_page(title, body)


def html_page(title: str, body: str) -> str:
    """A whole page, which needs no network, around a body with the scripts that it needs."""
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n{content_policy(body)}\n'
        f"<title>{escape(title)}</title>\n<style>{style_sheet()}</style>\n</head>\n<body>\n"
        f"{body}{body_scripts(body)}\n</body>\n</html>\n"
    )


def robot_title(findings: Findings) -> str:
    """The robot's full title, or the name that the files give it."""
    if findings.robot is not None:
        return findings.robot.description.title
    documents = (
        findings.plan,
        findings.refusals,
        findings.identification,
        findings.check,
        findings.diagnosis,
        findings.doctor,
    )
    return next(
        (document["robot"] for document in documents if document and document.get("robot")), "a robot"
    )


def _page_footer(findings: Findings) -> str:
    missing = "".join(f"<li>{escape(item)}</li>" for item in findings.left_out)
    said = f"<p>Left out, because this folder does not hold it:</p><ul>{missing}</ul>" if missing else ""
    read = html_paragraph(
        f"Made by excite from {', '.join(findings.files)}. Units are SI; angles are radians."
    )
    return f"<footer>{said}{read}</footer>"


# What no file said of the robot, and what follows from the values taken for it.


@section("assumed", "Assumed")
def show_assumed(findings: Findings) -> Content | str:
    """Everything that the robot's description assumed."""
    source = findings.plan or findings.refusals or findings.check or {}
    rows = [(one["what"], one["value"], one["consequence"]) for one in source.get("assumed", [])]
    if not rows:
        return ""
    lead = (
        "Neither the model nor its maker's files say these things of the robot. What the page finds safe is safe "
        "as far as they hold: state in robot.yaml what is known better, take it out of the list assumed there, and "
        "plan again."
    )
    return section_content(lead, html_table(("what", "taken", "what follows"), rows))


# A trial as it was measured, and as the model tells it before and after the effects.

_SHOWN = 4


@section("curves", "A trial before and after")
def show_curves(findings: Findings) -> Content | str:
    """The channels with the largest shares of the gap."""
    found, data = findings.diagnosis, findings.data.gap
    if found is None or data is None:
        return ""
    order = [row["channel"] for row in found["where"] if row["channel"] in data.channels]
    shown = (order or list(data.channels))[:_SHOWN]
    closed = bool(found["effects"])
    lead = f"Trial {data.trial}: what was measured and what the model says, and the difference between them."
    if closed:
        lead += " With the effects, the blue difference should be no more than noise."
    if len(shown) < len(data.channels):
        lead += f" The {len(shown)} channels with the largest shares of the gap."
    svg = to_svg(plot_left_over(data, shown, closed), "curves", "Measured and modelled, before and after")
    plots = live_chart(
        "curves-plots", data.time, list(_curve_panels(data, shown, closed)), inline_figure(svg)
    )
    return section_content(lead, plots)


def _curve_panels(data: ForceComparison, channels: Sequence[str], closed: bool) -> Iterator[dict[str, Any]]:
    """Two panels a channel: measured and modelled, and their difference."""
    models: list[tuple[dict[str, Any], Array]] = [
        ({"label": "the model", "role": "nominal", "dash": [5, 3]}, data.nominal)
    ]
    if closed:
        models.append(({"label": "with the effects", "role": "identified"}, data.identified))
    for name in channels:
        i = data.channels.index(name)
        measured, unit = data.measured[:, i], data.units[i]
        lines: list[tuple[dict[str, Any], Array]] = [({"label": "measured", "role": "ink"}, measured)]
        lines += [(line, values[:, i]) for line, values in models]
        yield {"title": f"{channel_label(name)} [{unit}]", "unit": unit, "series": lines}
        left = [(line, measured - values[:, i]) for line, values in models]
        yield {
            "title": f"{channel_label(name)}, measured less modelled [{unit}]",
            "unit": unit,
            "series": left,
        }


# What a model says of a trial beside what was measured, and the difference, before and after effects.

_MAX_POINTS = 800


def plot_left_over(data: ForceComparison, channels: Sequence[str], closed: bool) -> Figure:
    """Two panels a channel: measured and modelled on the left, their difference on the right.

    Args:
        data: the trial; ``nominal`` is the model, ``identified`` the model with the effects.
        channels: which channels, in their order.
        closed: whether there are effects.
    """
    shown = slice(None, None, max(1, math.ceil(len(data.time) / _MAX_POINTS)))
    time = data.time[shown]
    models: list[tuple] = [(data.nominal, NOMINAL, (0, (4, 2)), "the model")]
    if closed:
        models.append((data.identified, IDENTIFIED, "-", "with the effects"))

    def paint(figure: Figure) -> None:
        grid = figure.subplots(len(channels), 2, sharex=True, squeeze=False)
        for (left, right), name in zip(grid, channels, strict=True):
            i = data.channels.index(name)
            measured, unit = data.measured[shown, i], shorten_name(data.units[i])
            left.plot(time, measured, color=INK.light, lw=1.0, label="measured")
            for values, role, line, label in models:
                left.plot(time, values[shown, i], color=role.light, lw=1.0, ls=line, label=label)
                right.plot(time, measured - values[shown, i], color=role.light, lw=0.9)
            right.axhline(0.0, color=INK.light, lw=0.6)
            left.set_title(shorten_name(channel_label(name)))
            right.set_title("measured less modelled")
            left.set_ylabel(f"[{unit}]")
            left.margins(x=0.0)
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
        figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=3)

    return draw_figure(paint, height_in=0.7 + 1.45 * len(channels))


# Effects in the order of their evidence: accepted ones, those as likely, those that were tried.

_PARAMETERS = 3


@section("effects", "Effects")
def show_effects(findings: Findings) -> Content | str:
    """Accepted effects with their sizes, then what the first of them was preferred to."""
    found = findings.diagnosis
    if found is None or not (found["effects"] or found["candidates"]):
        return ""
    accepted = {(item["effect"], item["location"]) for item in found["effects"]}
    alike = {(item["effect"], item["location"]) for item in found["candidates"][: found["n_tied"]]}
    others = [c for c in found["candidates"] if (c["effect"], c["location"]) not in accepted]
    rows: list[tuple[Cell, ...]] = []
    for item in (*found["effects"], *others):
        key = (item["effect"], item["location"])
        standing = "as likely" if key in alike else "accepted" if key in accepted else "tried"
        rows.append(_effect_row(item, standing))
    headers = ("effect", "place", "", "evidence [nats]", "closed [%]", "size")
    lead = (
        "Evidence is a log-likelihood ratio over effective samples, less the price of the parameters and of the "
        "candidates tried: e to that power is by how much an effect is likelier than none."
    )
    units = (item["unit"] for item in found["gap"]["per_channel"].values())
    lead += f" {closed_in_words(of_positions(units)).capitalize()}."
    if not found["effects"]:
        lead += " None was accepted."
    tied = found["tied_locations"]
    places = (
        html_paragraph("Places that the record cannot tell apart: " + ", ".join(tied) + ".")
        if len(tied) > 1
        else ""
    )
    return section_content(lead, html_table(headers, rows), places)


def _effect_row(item: Document, standing: str) -> tuple[Cell, ...]:
    share = item["share_closed"]
    closed = None if share is None else round(100.0 * share)
    name = item["effect"].replace("_", " ")
    return (
        name,
        item["location"] or "",
        standing,
        item["evidence"],
        closed,
        _format_sizes(item["parameters"]),
    )


def _format_sizes(parameters: Document) -> str:
    said = []
    for name, entry in list(parameters.items())[:_PARAMETERS]:
        unit = "" if entry["unit"] == "1" else f" {entry['unit']}"
        spread = "" if entry["std"] is None else f" ± {format_number(entry['std'], 1)}"
        said.append(f"{name.replace('_', ' ')} {format_number(entry['value'], 4)}{spread}{unit}")
    more = len(parameters) - _PARAMETERS
    return "; ".join(said) + (f"; and {more} more" if more > 0 else "")


# What to measure next, what was wrong with the record, and the limits of what was said.


@section("record", "What to do, and what to keep in mind")
def show_record(findings: Findings) -> Content | str:
    """The next experiment, faults of the log and notes, each only where there is something to say."""
    found = findings.diagnosis
    if found is None:
        return ""
    content, following = [], found["next_experiment"]
    if following is not None:
        motion = f" The motion is in {following['motion']}." if following["motion"] else ""
        content.append(html_paragraph(f"Next: {following['why']}{motion}"))
    if found["log"]:
        rows: list[tuple[Cell, ...]] = [
            (item["what"], item["cause"], "repaired" if item["repaired"] else "left as it is")
            for item in found["log"]
        ]
        content.append(
            "<h3>Faults of the record</h3>"
            + html_table(("what", "what was done, or is to be done", ""), rows)
        )
    said = {item["what"] for item in found["log"]}
    notes = [*found["warnings"], *((found["simulation"] or {"warnings": ()})["warnings"])]
    notes = [text for text in notes if text not in said]
    if notes:
        content.append(
            "<h3>Limits</h3><ul>" + "".join(f"<li>{escape(text)}</li>" for text in notes) + "</ul>"
        )
    if not content:
        return ""
    return section_content("", *content)


# A diagnosis' held-out figures beside those of predictors that are far simpler than a simulator.

_COLUMNS = {
    "model": "model",
    "command": "the command",
    "delayed_command": "delayed and scaled",
    "fir": "linear filter",
    "repeat": "a repeat",
}
_ANGLES = {"rad": "mrad", "m": "mm"}


@section("trivial", "Beside simple predictors")
def show_trivial(findings: Findings) -> Content | str:
    """A row a channel: the model's error, then the command's, its delay's, a filter's, and what repeats differ by."""
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
    return section_content(
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


# How long each stage of the plan took.


@section("stages", "Time taken")
def show_stages(findings: Findings) -> Content | str:
    """Seconds by stage."""
    stages = (findings.plan or {}).get("stages")
    if not stages:
        return ""
    rows: list[tuple[Cell, ...]] = [(entry["stage"], round(float(entry["seconds"]), 2)) for entry in stages]
    total = ("all", sum(float(entry["seconds"]) for entry in stages))
    lead = "The plan's stages in the order in which they ran."
    return section_content(lead, html_table(("stage", "time [s]"), rows, total))


# The sections in the order of the page. A new one is one file beside this one and one line here.

SECTIONS: tuple[Section, ...] = (
    show_answer,
    show_verdict,
    show_overview,
    show_log_findings,
    show_torques_beside_model,
    show_moving,
    show_effects,
    show_budget_by_channel,
    show_gap_by_channel,
    show_trivial,
    show_where,
    show_baseline,
    show_curves,
    show_record,
    show_motions,
    show_refused,
    show_safety,
    show_assumed,
    show_excitation,
    show_certainty,
    show_forces,
    show_masses,
    show_person,
    show_differences,
    show_parameters,
    show_sessions,
    show_signals,
    show_stages,
)


# The page's style sheet: light and dark, wide and narrow, on paper.

_STYLE = """
:root { color-scheme: light dark; LIGHT --page: #f4f6f8; --good: #00704f; --bad: #b33a00; }
@media screen and (prefers-color-scheme: dark) { :root { DARK --page: #12161a; --good: #3fc89f; --bad: #f39149; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif; }
header, main, footer { max-width: 1080px; margin: 0 auto; padding: 0 16px; }
header { padding-top: 36px; }
header p { margin: 0; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0; letter-spacing: -.01em; }
h2 { font-size: 1.25rem; margin: 0 0 .3em; }
h3 { font-size: 1rem; margin: 1.4em 0 .4em; }
p { margin: .3em 0 .8em; max-width: 75ch; }
p, li, h1, h2, h3 { overflow-wrap: anywhere; }
p.lead, header p, footer, p.made { color: var(--muted); }
p.note { border-left: 3px solid var(--bad); padding-left: 10px; }
p.made { font-size: .88rem; margin: .5em 0 0; }
nav { display: flex; flex-wrap: wrap; gap: 4px 18px; margin: 14px 0 20px; font-size: .93rem; }
a { color: var(--identified); }
code { font: .92em ui-monospace, "DejaVu Sans Mono", monospace; overflow-wrap: anywhere; }
section { background: var(--paper); border: 1px solid var(--grid); border-radius: 10px;
  padding: 22px 24px; margin: 0 0 18px; }
.answer { border-left: 5px solid var(--muted); }
.answer.yes { border-left-color: var(--good); } .answer.no { border-left-color: var(--bad); }
.answer p { font-size: 1.12rem; max-width: 80ch; margin: 0; }
.answer p.next { font-size: 1rem; margin-top: .5em; } .answer p.made { font-size: .88rem; margin-top: .7em; }
.tiles { display: grid; gap: 12px; margin: 0 0 18px;
  grid-template-columns: repeat(auto-fit, minmax(225px, 1fr)); }
.tile { background: var(--paper); border: 1px solid var(--grid); border-radius: 10px; padding: 14px 16px; }
.tile b { display: block; font-size: 1.4rem; line-height: 1.25; }
.tile span { color: var(--muted); font-size: .88rem; line-height: 1.4; display: block; }
.tile b span { display: inline; }
.tile b span { font-size: 1.2rem; }
.good { color: var(--good); } .tile b .good { color: var(--good); }
.bad { color: var(--bad); } .tile b .bad { color: var(--bad); }
/* A shadow at an edge beyond which more follows: at an end, paper that moves with the content covers it. */
.wide { overflow-x: auto; margin: 12px 0; background:
  linear-gradient(to right, var(--paper) 30%, transparent) left / 36px 100% local no-repeat,
  linear-gradient(to left, var(--paper) 30%, transparent) right / 36px 100% local no-repeat,
  linear-gradient(to right, var(--muted), transparent) left / 6px 100% scroll no-repeat,
  linear-gradient(to left, var(--muted), transparent) right / 6px 100% scroll no-repeat; }
@media (max-width: 600px) { .wide td:nth-child(n+4):last-child:not(.number) { min-width: 13rem; } }
figure { margin: 0; min-width: 660px; }
figure svg { display: block; width: 100%; height: auto; }
table { border-collapse: collapse; font-size: .88rem; font-variant-numeric: tabular-nums; min-width: 50%; }
th { text-align: left; font-weight: 600; color: var(--muted); vertical-align: bottom; }
th, td { padding: 4px 16px 4px 0; border-bottom: 1px solid var(--grid); }
tfoot td { font-weight: 600; border-bottom: 0; }
.number { text-align: right; } td.number { white-space: nowrap; }
th:last-child, td:last-child { padding-right: 0; }
th.sorts { cursor: pointer; } th.sorts:hover, th.sorts:focus-visible { color: var(--identified); }
th[aria-sort=ascending]::after { content: " ↑"; } th[aria-sort=descending]::after { content: " ↓"; }
td.map { text-align: center; padding: 4px 10px; }
td.size { min-width: 22ch; }
p.verdict { font-size: 1.15rem; color: var(--ink); }
.stack { display: flex; height: 18px; border-radius: 4px; overflow: hidden; background: var(--ground);
  max-width: 720px; margin: 6px 0 10px; }
.stack span { display: block; height: 100%; border-right: 1px solid var(--paper); }
.legend { display: flex; flex-wrap: wrap; gap: 4px 18px; font-size: .88rem; color: var(--muted); max-width: none; }
.legend i { display: inline-block; width: 12px; height: 12px; border-radius: 3px; margin-right: 6px; }
details { margin: 10px 0; }
summary { cursor: pointer; color: var(--identified); }
footer { padding-bottom: 48px; font-size: .88rem; }
.moving { display: none; } .live .moving { display: block; } .live .moving.plots, .live .plots { display: grid; }
.interactive.ready > .still { display: none; }
.plots { gap: 14px 18px; grid-template-columns: repeat(auto-fit, minmax(min(100%, 420px), 1fr)); margin: 10px 0; }
.plot { min-width: 0; } .plot-title { font-size: .88rem; } .plot-note { font-size: .8rem; color: var(--muted);
  min-height: 1.3em; text-align: center; }
.plot .u-legend { font-size: .8rem; color: var(--muted); text-align: left; min-width: 0; width: 100%; }
.plot .u-legend th, .plot .u-legend td { border: 0; padding: 0 4px 0 0; }
.u-legend .quiet { display: none; }
.replay { margin: 12px 0; }
.replay-bar { display: flex; flex-wrap: wrap; gap: 8px 10px; align-items: center; margin-bottom: 8px; }
.replay-bar > select:first-child { flex: 2 1 360px; min-width: 0; max-width: 100%; }
.replay-bar input { flex: 2 1 140px; min-width: 0; accent-color: var(--identified); }
.replay-time { min-width: 8ch; text-align: right; font-variant-numeric: tabular-nums; font-size: .9rem; }
select, button { font: inherit; font-size: .9rem; color: var(--ink); background: var(--paper);
  border: 1px solid var(--muted); border-radius: 6px; padding: 4px 10px; }
button { min-width: 5.2em; cursor: pointer; background: var(--identified); color: var(--paper);
  border-color: var(--identified); }
.replay-main { display: grid; grid-template-columns: minmax(0, 1fr) 270px; gap: 16px; }
.replay-main:has(> .replay-margins[hidden]) { grid-template-columns: minmax(0, 1fr); }
.replay-stage { height: 440px; background: var(--ground); border-radius: 8px; overflow: hidden; }
.replay-stage[hidden] { display: none; }
.replay-stage canvas { display: block; cursor: grab; }
.replay-margins { font-size: .88rem; } .replay-margins[hidden] { display: none; }
.margin { display: grid; grid-template-columns: 1fr auto; gap: 1px 8px; margin: 7px 0; }
.margin-value { font-variant-numeric: tabular-nums; }
.margin-bar { grid-column: 1 / 3; height: 7px; border-radius: 4px; background: var(--ground); overflow: hidden; }
.margin-bar i { display: block; height: 100%; }
.margin-where { grid-column: 1 / 3; color: var(--muted); font-size: .8rem; min-height: 1.2em;
  white-space: nowrap; overflow: hidden; text-overflow: ellipsis; }
@media (max-width: 800px) { .replay-main { grid-template-columns: minmax(0, 1fr); }
  .replay-stage { height: min(75vw, 440px); } }
@media (max-width: 560px) { section { padding: 16px 14px; } header p { margin: 0; }
  table { font-size: .82rem; } th, td { padding-right: 9px; }
  h1 { font-size: 1.5rem; } .replay-margins { display: grid; gap: 0 14px; grid-template-columns: 1fr 1fr; }
  .replay-margins b { grid-column: 1 / 3; } }
@media print { :root { color-scheme: light; } body { background: none; }
  section, .tile { break-inside: avoid; border: 0; }
  nav, .live .moving, .live .moving.plots { display: none; } .interactive.ready > .still { display: block; }
  .wide { overflow: visible; background: none; } figure { min-width: 0; } details > *:not(summary) { display: block; }
  details::details-content { content-visibility: visible; block-size: auto; } }
""".replace("LIGHT", css_variables(dark=False)).replace("DARK", css_variables(dark=True))


def style_sheet() -> str:
    """The text of the page's ``<style>``."""
    return plot_style() + _STYLE
