"""Sections of the page of a diagnosis, and of a log that was looked through."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from typing import Any

import numpy as np

from excite.diagnosis.answer.answer import HELD, doubt_of_share, left_elsewhere, named_beside_closed
from excite.diagnosis.answer.budget import NOT_REPEATED
from excite.diagnosis.answer.gap import closed_in_words, of_positions
from excite.display import span
from excite.report.comparisons import ForceComparison
from excite.report.conclusions import VERDICTS
from excite.report.folder import Document, Findings
from excite.report.html import (
    Columns,
    Said,
    columns_table,
    folded_content,
    format_number,
    html_paragraph,
    inline_figure,
    key_figure,
    named_rows,
    percent_cell,
    percent_text,
)
from excite.report.plots.bars import Bars, draw_bars
from excite.report.plots.curves import MOST_PANELS, Line, Panel, channel_label, channel_panels, show_panels
from excite.report.plots.sketch import Sketch
from excite.report.sections.section import Content, section, section_content
from excite.report.theme import IDENTIFIED, INK, NOMINAL

# The gap of each channel against its noise floor, before and after the effects.


@section("gap", "Gap by channel")
def show_gap_by_channel(findings: Findings) -> Content | str:
    """Bars from the noise floor upwards; the numbers, with those of roll-outs."""
    found = findings.diagnosis
    if found is None:
        return ""
    channels, closed = named_rows(found["gap"]["per_channel"]), bool(found["effects"])
    lead = (
        "What the model leaves on trials that were not fitted, as a multiple of the noise floor: bars that end at "
        "the line leave nothing to explain."
    )
    drawing = draw_gap(channels, closed).to_svg("Gap of each channel over its noise floor")
    columns: Columns = {
        "channel": "name",
        "unit": "unit",
        "before": "before",
        "after": lambda item: item["after"] if closed else None,
        "noise floor": "noise_floor",
    }
    numbers = folded_content("Numbers", columns_table(channels, columns))
    return section_content(lead, inline_figure(drawing), numbers, _rollout_table(found["simulation"]))


def _rollout_table(simulation: Document | None) -> str:
    if simulation is None or not simulation["before"]:
        return ""
    columns: dict[str, Any] = {"channel": str}
    named = {"before": "before", "after": "after", "what noise alone makes": "floor"}
    columns |= {title: partial(_milli_error, simulation[key]) for title, key in named.items()}
    how = f"{simulation['horizon_s']:g} s, driven by {simulation['driven_by']}"
    return folded_content(
        f"Roll-outs of {how}: errors [mrad or mm]", columns_table(simulation["before"], columns)
    )


def _milli_error(errors: Document, name: str) -> float | None:
    value = errors.get(name)
    return None if value is None else 1e3 * value


# Least noise floor, and largest multiple of it, that an axis can show.
_LEAST, _MOST = 1e-200, 1e200


def draw_gap(channels: list[dict[str, Any]], closed: bool) -> Sketch:
    """A bar a channel from the noise floor to the gap, on a logarithmic scale; a narrow one with the effects.

    Args:
        channels: each ``name``, and ``before``, ``after`` and ``noise_floor`` in one unit.
        closed: whether there are effects, so that ``after`` says something.
    """
    keys = ("noise_floor", "before", "after")
    # A value that is not known is NaN, and its bar is not drawn.
    floor, *both = (np.array([one[key] for one in channels], dtype=float) for key in keys)
    before, after = (np.clip(one / np.maximum(floor, _LEAST), 1.0, _MOST) for one in both)
    shown = (before, after) if closed else (before,)
    return draw_bars(
        Bars(
            [channel_label(one["name"]) for one in channels],
            before,
            after if closed else None,
            ("the model", "with the effects"),
            "gap over its noise floor (no unit, log scale)",
            log=True,
            texts=[
                "" if np.isnan(pair).any() else " → ".join(f"{x:.3g}" for x in pair)
                for pair in zip(*shown, strict=True)
            ],
        )
    )


# What the gap is counted from: sizes that the model took from the record before the first effect was asked for.

_BODIES = {
    "rigid_body": "The bodies' base parameters were fitted to this record, too.",
    "rigid_body_fixed": "The bodies are as the model has them.",
}
_BASELINE: Columns = {
    "joint": "joint",
    "parameter": lambda item: item["parameter"].replace("_", " "),
    "value": "value",
    "±": "std",
    "90 % interval": lambda item: _interval_text(item["interval90"], format_number),
    "unit": "unit",
}


@section("baseline", "What the baseline was fitted to")
def show_baseline(findings: Findings) -> Content | str:
    """A row a joint and parameter, with its interval."""
    found = findings.diagnosis
    if found is None or not found["baseline"]:
        return ""
    lead = (
        "The gap is what is left with these sizes, which the record decided before any effect was asked for: "
        "what they have taken up is no effect. Beside the accepted effects they may come out otherwise."
    )
    bodies = [html_paragraph(text) for word, text in _BODIES.items() if word in found["modelled"]]
    return section_content(lead, columns_table(found["baseline"], _BASELINE), *bodies)


# Where each channel's gap goes: noise floor, named effects with their intervals, unnamed shares, the rest.

# Channels with less of the whole gap are folded away.
_SMALL = 0.02
# Parts of a sentence, the least of them, and of what does harm.
_SAID, _WORTH, _HARMS = 3, 0.02, 0.05


@dataclass(frozen=True)
class _Part:
    """A part of a channel's gap: what it is, its share, the interval, what it is drawn with."""

    what: str
    share: float | None
    interval: tuple[float, float] | None
    kind: str


@section("budget", "Where the gap goes")
def show_budget_by_channel(findings: Findings) -> Content | str:
    """A sentence, a stacked bar and a table for each channel, the largest part of the gap first."""
    found = findings.diagnosis
    if found is None or not found["budget"]:
        return ""
    order = sorted(found["budget"].items(), key=lambda item: -(item[1]["weight"] or 0.0))
    blocks = [(item["weight"] or 0.0, _render_channel(name, item)) for name, item in order]
    large = "".join(html for weight, html in blocks if weight >= _SMALL) or blocks[0][1]
    small = "".join(html for weight, html in blocks[1:] if weight < _SMALL)
    if not any(weight > 0.0 for weight, _ in blocks):
        lead = "No joint's gap stands above its noise floor: there is nothing to share out."
        every = folded_content("Noise floors", "".join(html for _, html in blocks))
        return section_content(lead, every)
    lead = _channel_sentence(*order[0])
    how = (
        "Shares are of the power above the noise floor on trials that were not fitted, all effects taken together; "
        "those of a channel add up to one. An interval says what a share would be on other stretches of such a "
        "record: blocks of it were left out in turn. Instants at which a joint stands or turns round count for "
        "next to nothing here, so that gap and noise floor are other numbers than under Gap by channel, where each "
        f"instant counts. The {HELD}."
    )
    rest = (
        folded_content(f"Joints with less than {100 * _SMALL:.0f} % of the whole gap", small) if small else ""
    )
    beside = _explain_difference(found, order) + _explain_elsewhere(found)
    return section_content(lead, html_paragraph(how), beside, _bar_legend(), large, rest)


_PARTS_COLUMNS: Columns = {
    "part": lambda part: part.what,
    "share": lambda part: percent_cell(part.share),
    "90 % interval": lambda part: _interval_text(part.interval),
    "": lambda part: "" if part.interval is None else doubt_of_share(part.share, *part.interval),
}


def _render_channel(name: str, channel: Document) -> str:
    """A channel's heading, bar and table."""
    parts = list(_channel_parts(channel))
    floor, gap, unit = format_number(channel["noise_floor"]), format_number(channel["gap"]), channel["unit"]
    size = f"gap {gap} {unit}, noise floor {floor} {unit}, {percent_text(channel['weight'])} of the whole gap"
    return (
        f"<h3>{escape(channel_label(name))}</h3>{html_paragraph(size, 'lead')}{_stacked_bar(parts)}"
        f"{columns_table(parts, _PARTS_COLUMNS)}"
    )


def _interval_text(
    interval: Sequence[float | None] | None, text: Callable[[float | None], str] = percent_text
) -> str:
    if interval is None:
        return "–"
    low, high = map(text, interval)
    return span(low, high, " to ")


def _bare_percent(share: float | None) -> str:
    return percent_text(share).removesuffix(" %")


def _channel_parts(channel: Document) -> Iterator[_Part]:
    """Parts of a channel's gap, named effects first, the largest of each kind first."""
    for item in sorted(channel["effects"], key=lambda item: -(item["share"] or 0.0)):
        low, high = item["interval90"]
        bounds = None if low is None or high is None else (low, high)
        what = f"{item['effect'].replace('_', ' ')} at {item['location']}"
        yield _Part(what, item["share"], bounds, "identified")
    for item in sorted(channel["unnamed"], key=lambda item: -(item["share"] or 0.0)):
        repeats = item["follows"] == NOT_REPEATED
        what = NOT_REPEATED if repeats else f"follows {item['follows']}, without a name"
        yield _Part(what, item["share"], None, "muted" if repeats else "nominal")
    yield _Part("the rest", channel["rest"], None, "pale")


def _stacked_bar(parts: list[_Part]) -> str:
    """A stacked bar; what does harm has no width, and the others are drawn to their sum."""
    sizes = [max(part.share or 0.0, 0.0) for part in parts]
    whole = max(sum(sizes), 1.0)
    pieces = "".join(
        f'<span style="width: {100 * size / whole:.2f}%; background: var(--{part.kind})" '
        f'title="{escape(part.what)} {percent_text(part.share)}"></span>'
        for part, size in zip(parts, sizes, strict=True)
        if size > 0.0
    )
    said = escape("; ".join(f"{part.what} {percent_text(part.share)}" for part in parts))
    return f'<div class="stack" role="img" aria-label="{said}">{pieces}</div>'


def _bar_legend() -> str:
    kinds = {
        "identified": "named effects",
        "nominal": "follows something, no name",
        "muted": NOT_REPEATED,
        "pale": "the rest",
    }
    items = "".join(
        f'<span><i style="background: var(--{kind})"></i>{text}</span>' for kind, text in kinds.items()
    )
    return f'<p class="legend">{items}</p>'


def _channel_sentence(name: str, channel: Document) -> str:
    """``Of the gap at joint 2 (0.41 N·m above 0.05 noise), 63 % is Coulomb friction …``."""
    *named, rest = _channel_parts(channel)
    large = sorted((part for part in named if _is_worth_naming(part)), key=lambda part: -(part.share or 0.0))
    said = [f"{percent_text(part.share)} {_part_verb(part)}" for part in large[:_SAID]]
    listed = ", ".join([*said, f"{percent_text(rest.share)} is {'the rest' if said else 'without a name'}"])
    size = (
        f"{format_number(channel['gap'], 2)} {channel['unit']} above "
        f"{format_number(channel['noise_floor'], 2)} noise"
    )
    return f"Of the gap at {channel_label(name)} ({size}), {listed}."


def _is_worth_naming(part: _Part) -> bool:
    """Whether a part is worth a word: of one that does harm, what makes the others more than all."""
    share = part.share or 0.0
    return share >= _WORTH or share <= -_HARMS


def _part_verb(part: _Part) -> str:
    if part.what.startswith(("follows", "does")):
        return part.what
    return f"is {part.what}" + (", which does harm there" if (part.share or 0.0) < 0.0 else "")


def _explain_difference(found: Document, order: list[tuple[str, Document]]) -> str:
    """Why the parts with a name are not what the accepted effects close, where they differ."""
    named = sum(
        (channel["weight"] or 0.0) * sum(item["share"] or 0.0 for item in channel["effects"])
        for _, channel in order
    )
    return _note(named_beside_closed(named, found["gap"]["share_closed"], accepted=bool(found["effects"])))


def _explain_elsewhere(found: Document) -> str:
    """Why the gap by channel lies at another joint, where it does."""
    gaps = {name: (item["before"], item["noise_floor"]) for name, item in found["gap"]["per_channel"].items()}
    weights = {name: item["weight"] or 0.0 for name, item in found["budget"].items()}
    return _note(left_elsewhere(gaps, weights, found["modelled"]))


def _note(said: str) -> str:
    return html_paragraph(f"{said[0].upper()}{said[1:]}.", "note") if said else ""


# A diagnosis in a row of key figures.

# An interval that begins below this part of the share closed contradicts it at first sight.
_SURE = 0.5
# A roll-out's error below this multiple of what noise alone makes is as good as noise: where a diagnosis finds nothing,
# channels of an arm err by 0.9 to 2.6 times it and those of a humanoid by 0.9 to 1.7; with a payload by 80 and more.
_NOISE = 3.0
# Shares that differ by more are worth a word.
_DIFFERS = 0.15


@section("verdict")
def show_verdict(findings: Findings) -> Content | str:
    """The gap before and after, how far it closes, what roll-outs say."""
    found = findings.diagnosis
    if found is None:
        return ""
    return (
        '<div class="tiles" '
        f'id="verdict">{"".join(_verdict_tiles(found))}</div>{_explain_disagreement(found)}'
    )


def _verdict_tiles(found: Document) -> Iterator[str]:
    verdict, gap, closed = found["verdict"], found["gap"], bool(found["effects"])
    yield key_figure(verdict, VERDICTS[verdict])
    before, after, noise = (percent_text(gap[key], ".3g") for key in ("before", "after", "noise_floor"))
    size = f"{before} → {after}" if closed else before
    yield key_figure(size, f"of the signal is not explained; {noise} is noise")
    if not closed:
        return
    bounds = gap["share_closed_90"]
    within = f"; 90 % interval {_interval_text(bounds, _bare_percent)} %" if bounds else ""
    if bounds and None not in bounds and bounds[0] < _SURE * (gap["share_closed"] or 0.0):
        within += (
            ": so much is closed on the trials that judge, which are too few or too short to say it of others"
        )
    units = (item["unit"] for item in gap["per_channel"].values())
    of = "gap of the positions" if of_positions(units) else "gap"
    yield key_figure(percent_text(gap["share_closed"]), f"of the {of} above the noise is closed{within}")
    rollouts = found["simulation"]
    if rollouts and rollouts["before"]:
        share, horizon = rollout_share(rollouts), f"{rollouts['horizon_s']:g} s"
        how = f"of the error above noise of {horizon} roll-outs is mended"
        if share is None:
            how = f"roll-outs of {horizon} err by no more than noise makes: they cannot tell"
        yield key_figure(percent_text(share), how)


def rollout_share(rollouts: Document) -> float | None:
    """Share of the roll-outs' squared error above their noise that the effects close, all channels together.

    The share of the gap is counted likewise, so that the two can be compared. Channels count in units of their noise,
    since metres and radians do not add; one that errs by no more than :data:`_NOISE` times that says nothing. None
    where none says anything.
    """
    was = now = 0.0
    for name, before in rollouts["before"].items():
        after, floor = rollouts["after"][name], rollouts["floor"].get(name) or 0.0
        if before is None or after is None or before <= _NOISE * floor or not before:
            continue
        unit = floor or before
        least = (floor / unit) ** 2
        was += (before / unit) ** 2 - least
        now += max((after / unit) ** 2 - least, 0.0)
    return 1.0 - now / was if was > 0.0 else None


def _explain_disagreement(found: Document) -> str:
    """Why torques and roll-outs say different things of the same effects, where they do."""
    closed, rollouts = found["gap"]["share_closed"], found["simulation"]
    if not found["effects"] or closed is None or not rollouts or not rollouts["before"]:
        return ""
    share = rollout_share(rollouts)
    if share is None or abs(share - closed) <= _DIFFERS:
        return ""
    left_out = rollouts["before"] == rollouts["after"]
    why = (
        "the written simulator leaves the effects out, for they bring no roll-out nearer to the record"
        if left_out
        else "a simulator can express some effects only in part, and what it makes of an error grows with time"
    )
    return html_paragraph(
        f"{percent_text(closed)} and {percent_text(share)} are both right. The first is what "
        "the effects explain of the "
        f"readings, instant by instant; the second what they mend of where the simulator goes on its own for "
        f"{rollouts['horizon_s']:g} s: {why}.",
        "note",
    )


# The map of the gap: which channels, and what each one's follows.


@section("where", "Where it lies")
def show_where(findings: Findings) -> Content | str:
    """A row a channel, a column for each thing that its gap may follow; the fuller the colour, the more it does."""
    found = findings.diagnosis
    if found is None or not found["where"]:
        return ""
    lead = (
        "Before any effect is added. Each cell says what share of the channel's gap, on trials that were fitted, "
        "functions of that one thing would explain; several may look alike, and what does not hold on the trials "
        "that judge is no part of Where the gap goes. The band holds the middle 80 % of the gap's power."
    )
    what = dict.fromkeys(name for row in found["where"] for name in row["dependence"])
    columns: Columns = {
        "channel": lambda row: channel_label(row["channel"]),
        "share of the gap": lambda row: percent_cell(row["share"], shaded=True),
        **{name.replace("_", " "): partial(_dependence_cell, name) for name in what},
        "band [Hz]": lambda row: " to ".join("–" if end is None else f"{end:.2g}" for end in row["band_hz"]),
    }
    return section_content(lead, columns_table(found["where"], columns))


def _dependence_cell(name: str, row: Document) -> Said:
    return percent_cell(row["dependence"].get(name), shaded=True)


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
    panels = [panel for name in shown for panel in _curve_panels(data, name, closed)]
    said = "Measured and modelled, before and after"
    return section_content(lead, show_panels("curves", data.time, panels, said))


def _curve_panels(data: ForceComparison, name: str, closed: bool) -> tuple[Panel, Panel]:
    """Measured and modelled, and their difference."""
    i = data.channels.index(name)
    measured, unit, label = data.measured[:, i], data.units[i], channel_label(name)
    models = [Line("the model", NOMINAL, data.nominal[:, i], dashed=True)]
    models += [Line("with the effects", IDENTIFIED, data.identified[:, i])] if closed else []
    left = tuple(replace(line, values=measured - line.values) for line in models)
    return (
        Panel(label, unit, (Line("measured", INK, measured), *models)),
        Panel(f"{label}, measured less modelled", unit, left),
    )


# Effects in the order of their evidence: accepted ones, those as likely, those that were tried.

_PARAMETERS = 3
_EFFECTS: Columns = {
    "effect": lambda item: item["effect"].replace("_", " "),
    "place": lambda item: item["location"] or "",
    "": "standing",
    "evidence [nats]": "evidence",
    "closed [%]": lambda item: None if item["share_closed"] is None else round(100.0 * item["share_closed"]),
    "size": lambda item: _format_sizes(item["parameters"]),
}


@section("effects", "Effects")
def show_effects(findings: Findings) -> Content | str:
    """Accepted effects with their sizes, then what the first of them was preferred to."""
    found = findings.diagnosis
    if found is None or not (found["effects"] or found["candidates"]):
        return ""
    accepted = {(item["effect"], item["location"]) for item in found["effects"]}
    alike = {(item["effect"], item["location"]) for item in found["candidates"][: found["n_tied"]]}
    others = [c for c in found["candidates"] if (c["effect"], c["location"]) not in accepted]
    rows = [
        {**item, "standing": "as likely" if key in alike else "accepted" if key in accepted else "tried"}
        for item in (*found["effects"], *others)
        for key in [(item["effect"], item["location"])]
    ]
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
    return section_content(lead, columns_table(rows, _EFFECTS), places)


def _format_sizes(parameters: Document) -> str:
    said = []
    for name, entry in list(parameters.items())[:_PARAMETERS]:
        unit = "" if entry["unit"] == "1" else f" {entry['unit']}"
        spread = "" if entry["std"] is None else f" ± {format_number(entry['std'], 1)}"
        said.append(f"{name.replace('_', ' ')} {format_number(entry['value'], 4)}{spread}{unit}")
    more = len(parameters) - _PARAMETERS
    return "; ".join(said) + (f"; and {more} more" if more > 0 else "")


# What to measure next, what was wrong with the record, and the limits of what was said.

_FAULTS: Columns = {
    "what": "what",
    "what was done, or is to be done": "cause",
    "": lambda item: "repaired" if item["repaired"] else "left as it is",
}


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
        content.append("<h3>Faults of the record</h3>" + columns_table(found["log"], _FAULTS))
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

_PREDICTORS = {
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
    shown = {k: v for k, v in _PREDICTORS.items() if any(item[k] is not None for item in errors.values())}
    if found is None or not shown.keys() - {"model"}:
        return ""
    columns: dict[str, Any] = {
        "channel": lambda item: channel_label(item["name"]),
        "unit": lambda item: _ANGLES.get(item["unit"], str(item["unit"])),
        **{title: partial(_sized_value, key) for key, title in shown.items()},
    }
    said = [item["message"] for item in found["findings"] if item["code"] == "no_better_than_trivial"]
    return section_content(
        _trivial_lead(found, "fir" in shown),
        columns_table(named_rows(errors), columns),
        *(html_paragraph(f"{text[:1].upper()}{text[1:]}.", "note") for text in said),
    )


def _trivial_lead(found: Document, of_commands: bool) -> str:
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


def _sized_value(key: str, item: Document) -> float | None:
    value = item[key]
    return None if value is None else value * (1e3 if item["unit"] in _ANGLES else 1.0)


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
    columns: dict[str, Any] = {
        "how bad": lambda item: "mended" if item["repaired"] else _MEANS[item["severity"]],
        "what was found": "text",
        "what was done, or is to be done": "remedy",
        "where": _finding_place,
    }
    if any(item["sure"] < 1.0 for item in found["findings"]):
        columns["sure"] = lambda item: f"{100.0 * item['sure']:.0f} %"
    return section_content(lead, columns_table(found["findings"], columns))


def _finding_place(item: Document) -> str:
    where = _list_places(item["places"])
    if item["trials"]:
        where += f"{'; ' if where else ''}in {_list_places(item['trials'])}"
    return where


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
    panels = channel_panels(data, (_MODEL, _LOGGED, _REPAIRED), order)
    lead = (
        f"Trial {data.trial}: the torques as they stand in the log and as they were repaired, beside those of the "
        "nominal model's bodies in the repaired motion, with an offset, friction and a rotor fitted to each joint. "
        "What is left between them may be the model's fault as well."
    )
    if len(panels) < len(data.channels):
        lead += f" Drawn are {MOST_PANELS} of {len(data.channels)} joints, those of the findings first."
    said = "Torques as logged, as repaired and as the model needs them"
    return section_content(lead, show_panels("beside-model", data.time, panels, said))
