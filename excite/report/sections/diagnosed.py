"""Sections of the page of a diagnosis, and of a log that was looked through."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from excite.diagnosis.answer.answer import HELD, explain_named_share, explain_other_joint, explain_share
from excite.diagnosis.answer.gap import NOT_REPEATED, describe_closed, of_positions
from excite.display import span
from excite.finding import list_names
from excite.report.conclusions import VERDICTS
from excite.report.folder import Document, Findings
from excite.report.html import (
    Columns,
    Said,
    Shown,
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
from excite.report.plots.curves import Bars, Line, Panel, channel_label, draw_bars, show_panels
from excite.report.theme import IDENTIFIED, INK, NOMINAL, to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The gap of each channel against its noise floor, before and after the effects.


def show_gap_by_channel(findings: Findings) -> Shown:
    """Bars from the noise floor upwards; the numbers, with those of roll-outs."""
    found = findings.diagnosis
    if found is None:
        return ""
    channels, closed = named_rows(found["gap"]["per_channel"]), bool(found["effects"])
    columns: Columns = {
        "channel": "name",
        "unit": "unit",
        "before": "before",
        "after": lambda item: item["after"] if closed else None,
        "noise floor": "noise_floor",
    }
    return [
        "What the model leaves on trials that were not fitted, as a multiple of the noise floor: bars that end at "
        "the line leave nothing to explain.",
        inline_figure(
            to_svg(draw_gap(channels, closed), "gap-bars", "Gap of each channel over its noise floor")
        ),
        folded_content("Numbers", columns_table(channels, columns)),
        _rollout_table(found["simulation"]),
    ]


def draw_gap(channels: list[dict[str, Any]], closed: bool) -> Figure:
    """A bar a channel from the noise floor to the gap, on a logarithmic scale; a narrow one with the effects.

    Args:
        channels: each ``name``, and ``before``, ``after`` and ``noise_floor`` in one unit.
        closed: whether there are effects, so that ``after`` says something.
    """
    floor, *both = (
        np.array([one[key] for one in channels], dtype=float) for key in ("noise_floor", "before", "after")
    )
    # A value that is not known is NaN, and its bar is not drawn.
    times = [np.clip(one / np.maximum(floor, 1e-200), 1.0, 1e200) for one in both][: 1 + closed]
    pairs = zip(*times, strict=True)
    bars = Bars(
        [channel_label(one["name"]) for one in channels],
        times[0],
        times[1] if closed else None,
        ("the model", "with the effects"),
        "gap over its noise floor (no unit, log scale)",
        log=True,
        texts=["" if np.isnan(pair).any() else " → ".join(f"{x:.3g}" for x in pair) for pair in pairs],
    )
    return draw_bars(bars)


def _rollout_table(simulation: Document | None) -> str:
    if simulation is None or not simulation["before"]:
        return ""
    named = {"before": "before", "after": "after", "what noise alone makes": "floor"}
    rows = [
        {"name": name} | {k: _scale_value(simulation[k].get(name)) for k in named.values()}
        for name in simulation["before"]
    ]
    how = f"{simulation['horizon_s']:g} s, driven by {simulation['driven_by']}"
    table = columns_table(rows, {"channel": "name", **named})
    return folded_content(f"Roll-outs of {how}: errors [mrad or mm]", table)


def _scale_value(value: float | None, times: float = 1e3) -> float | None:
    return None if value is None else times * value


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
    "90 % interval": lambda item: _interval_text(map(format_number, item["interval90"] or ())),
    "unit": "unit",
}


def show_baseline(findings: Findings) -> Shown:
    """A row a joint and parameter, with its interval."""
    found = findings.diagnosis
    if found is None or not found["baseline"]:
        return ""
    return [
        "The gap is what is left with these sizes, which the record decided before any effect was asked for: "
        "what they have taken up is no effect. Beside the accepted effects they may come out otherwise.",
        columns_table(found["baseline"], _BASELINE),
        *(html_paragraph(text) for word, text in _BODIES.items() if word in found["modelled"]),
    ]


def _interval_text(texts: Iterable[str]) -> str:
    ends = list(texts)
    return span(ends[0], ends[1], " to ") if ends else "–"


# Where each channel's gap goes: noise floor, named effects with their intervals, unnamed shares, the rest.

# Channels with less of the whole gap are folded away.
_SMALL = 0.02


class _Part(NamedTuple):
    """A part of a channel's gap: what it is, its share, the interval, what it is drawn with."""

    what: str
    share: float | None
    interval: tuple[float, float] | None = None
    kind: str = "pale"


_KINDS = {
    "identified": "named effects",
    "nominal": "follows something, no name",
    "muted": NOT_REPEATED,
    "pale": "the rest",
}


def show_budget_by_channel(findings: Findings) -> Shown:
    """A sentence, a stacked bar and a table for each channel, the largest part of the gap first."""
    found = findings.diagnosis
    if found is None or not found["budget"]:
        return ""
    weights = {name: item["weight"] or 0.0 for name, item in found["budget"].items()}
    order = sorted(found["budget"].items(), key=lambda item: -weights[item[0]])
    blocks = {name: _render_channel(name, item) for name, item in order}
    if not any(weights.values()):
        lead = "No joint's gap stands above its noise floor: there is nothing to share out."
        return [lead, folded_content("Noise floors", "".join(blocks.values()))]
    small = [name for name in list(blocks)[1:] if weights[name] < _SMALL]
    named = sum(weights[name] * sum(e["share"] or 0.0 for e in item["effects"]) for name, item in order)
    gaps = {name: (item["before"], item["noise_floor"]) for name, item in found["gap"]["per_channel"].items()}
    legend = "".join(
        f'<span><i style="background: var(--{kind})"></i>{text}</span>' for kind, text in _KINDS.items()
    )
    folded = "".join(blocks[name] for name in small)
    return [
        _channel_sentence(*order[0]),
        html_paragraph(
            "Shares are of the power above the noise floor on trials that were not fitted, all effects taken together; "
            "those of a channel add up to one. An interval says what a share would be on other stretches of such a "
            "record: blocks of it were left out in turn. Instants at which a joint stands or turns round count for "
            "next to nothing here, so that gap and noise floor are other numbers than under Gap by channel, where each "
            f"instant counts. The {HELD}."
        ),
        _note_paragraph(
            explain_named_share(named, found["gap"]["share_closed"], accepted=bool(found["effects"]))
        ),
        _note_paragraph(explain_other_joint(gaps, weights, found["modelled"])),
        f'<p class="legend">{legend}</p>',
        *(block for name, block in blocks.items() if name not in small),
        folded_content(f"Joints with less than {100 * _SMALL:.0f} % of the whole gap", folded)
        if small
        else "",
    ]


_PARTS_COLUMNS: Columns = {
    "part": lambda part: part.what,
    "share": lambda part: percent_cell(part.share),
    "90 % interval": lambda part: _interval_text(map(percent_text, part.interval or ())),
    "": lambda part: "" if part.interval is None else explain_share(part.share, *part.interval),
}


def _render_channel(name: str, channel: Document) -> str:
    """A channel's heading, bar and table; in the bar what does harm has no width, the others are drawn to their sum."""
    parts = list(_channel_parts(channel))
    floor, gap, unit = format_number(channel["noise_floor"]), format_number(channel["gap"]), channel["unit"]
    size = f"gap {gap} {unit}, noise floor {floor} {unit}, {percent_text(channel['weight'])} of the whole gap"
    drawn = [part for part in parts if (part.share or 0.0) > 0.0]
    whole = max(sum(part.share or 0.0 for part in drawn), 1.0)
    pieces = "".join(
        f'<span style="width: {100 * (part.share or 0.0) / whole:.2f}%; background: var(--{part.kind})" '
        f'title="{escape(part.what)} {percent_text(part.share)}"></span>'
        for part in drawn
    )
    said = escape("; ".join(f"{part.what} {percent_text(part.share)}" for part in parts))
    return (
        f"<h3>{escape(channel_label(name))}</h3>{html_paragraph(size, 'lead')}"
        f'<div class="stack" role="img" aria-label="{said}">{pieces}</div>{columns_table(parts, _PARTS_COLUMNS)}'
    )


def _channel_parts(channel: Document) -> Iterator[_Part]:
    """Parts of a channel's gap, named effects first, the largest of each kind first."""
    for item in _largest_first(channel["effects"]):
        low, high = item["interval90"]
        what = f"{item['effect'].replace('_', ' ')} at {item['location']}"
        yield _Part(what, item["share"], None if None in (low, high) else (low, high), "identified")
    for item in _largest_first(channel["unnamed"]):
        repeats = item["follows"] == NOT_REPEATED
        what = NOT_REPEATED if repeats else f"follows {item['follows']}, without a name"
        yield _Part(what, item["share"], None, "muted" if repeats else "nominal")
    yield _Part("the rest", channel["rest"])


def _largest_first(items: list[Document]) -> list[Document]:
    return sorted(items, key=lambda item: -(item["share"] or 0.0))


def _channel_sentence(name: str, channel: Document) -> str:
    """``Of the gap at joint 2 (0.41 N·m above 0.05 noise), 63 % is Coulomb friction …``."""
    *named, rest = _channel_parts(channel)
    sizes = [(part.share or 0.0, part) for part in named]
    # Of a part that does harm it is worth a word what makes the others more than all.
    large = sorted((one for one in sizes if not -0.05 < one[0] < 0.02), key=lambda one: -one[0])[:3]
    said = []
    for share, part in large:
        verb = "" if part.what.startswith(("follows", "does")) else "is "
        said.append(
            f"{percent_text(share)} {verb}{part.what}{', which does harm there' if verb and share < 0.0 else ''}"
        )
    listed = ", ".join([*said, f"{percent_text(rest.share)} is {'the rest' if said else 'without a name'}"])
    gap, floor = format_number(channel["gap"], 2), format_number(channel["noise_floor"], 2)
    return f"Of the gap at {channel_label(name)} ({gap} {channel['unit']} above {floor} noise), {listed}."


def _note_paragraph(said: str) -> str:
    return html_paragraph(f"{said[0].upper()}{said[1:]}.", "note") if said else ""


# A diagnosis in a row of key figures.

# An interval that begins below this part of the share closed contradicts it at first sight.
_SURE = 0.5
# A roll-out's error below this multiple of what noise alone makes is as good as noise: where a diagnosis finds nothing,
# channels of an arm err by 0.9 to 2.6 times it and those of a humanoid by 0.9 to 1.7; with a payload by 80 and more.
_NOISE = 3.0
# Shares that differ by more are worth a word.
_DIFFERS = 0.15


def show_verdict(findings: Findings) -> Shown:
    """The gap before and after, how far it closes, what roll-outs say."""
    found = findings.diagnosis
    if found is None:
        return ""
    tiles = "".join(_verdict_tiles(found))
    return f'<div class="tiles" id="verdict">{tiles}</div>{_explain_disagreement(found)}'


def _verdict_tiles(found: Document) -> Iterator[str]:
    verdict, gap, closed, rollouts = (
        found["verdict"],
        found["gap"],
        bool(found["effects"]),
        found["simulation"],
    )
    yield key_figure(verdict, VERDICTS[verdict])
    before, after, noise = (percent_text(gap[key], ".3g") for key in ("before", "after", "noise_floor"))
    yield key_figure(
        f"{before} → {after}" if closed else before, f"of the signal is not explained; {noise} is noise"
    )
    if not closed:
        return
    bounds = gap["share_closed_90"]
    within = ""
    if bounds:
        within = f"; 90 % interval {_interval_text(percent_text(x).removesuffix(' %') for x in bounds)} %"
        if None not in bounds and bounds[0] < _SURE * (gap["share_closed"] or 0.0):
            within += ": so much is closed on the trials that judge, which are too few or too short to say it of others"
    of = "gap of the positions" if of_positions(_channel_units(gap)) else "gap"
    yield key_figure(percent_text(gap["share_closed"]), f"of the {of} above the noise is closed{within}")
    if rollouts and rollouts["before"]:
        share, horizon = rollout_share(rollouts), f"{rollouts['horizon_s']:g} s"
        how = f"of the error above noise of {horizon} roll-outs is mended"
        if share is None:
            how = f"roll-outs of {horizon} err by no more than noise makes: they cannot tell"
        yield key_figure(percent_text(share), how)


def _channel_units(gap: Document) -> Iterator[str]:
    return (item["unit"] for item in gap["per_channel"].values())


def rollout_share(rollouts: Document) -> float | None:
    """Share of the roll-outs' squared error above their noise that the effects close, all channels together.

    The share of the gap is counted likewise, so that the two can be compared. Channels count in units of their noise,
    since metres and radians do not add; one that errs by no more than :data:`_NOISE` times that says nothing. None
    where none says anything.
    """
    was = now = 0.0
    for name, before in rollouts["before"].items():
        after, floor = rollouts["after"][name], rollouts["floor"].get(name) or 0.0
        if before and after is not None and before > _NOISE * floor:
            unit = floor or before
            least = (floor / unit) ** 2
            was += (before / unit) ** 2 - least
            now += max((after / unit) ** 2 - least, 0.0)
    return 1.0 - now / was if was > 0.0 else None


def _explain_disagreement(found: Document) -> str:
    """Why torques and roll-outs say different things of the same effects, where they do."""
    closed, rollouts = found["gap"]["share_closed"], found["simulation"]
    share = rollout_share(rollouts) if rollouts and found["effects"] else None
    if closed is None or share is None or abs(share - closed) <= _DIFFERS:
        return ""
    why = (
        "the written simulator leaves the effects out, for they bring no roll-out nearer to the record"
        if rollouts["before"] == rollouts["after"]
        else "a simulator can express some effects only in part, and what it makes of an error grows with time"
    )
    return html_paragraph(
        f"{percent_text(closed)} and {percent_text(share)} are both right. The first is what the effects explain of "
        f"the readings, instant by instant; the second what they mend of where the simulator goes on its own for "
        f"{rollouts['horizon_s']:g} s: {why}.",
        "note",
    )


def show_where(findings: Findings) -> Shown:
    """A row a channel, a column for each thing that its gap may follow; the fuller the colour, the more it does."""
    found = findings.diagnosis
    if found is None or not found["where"]:
        return ""
    what = dict.fromkeys(name for row in found["where"] for name in row["dependence"])
    columns: Columns = {
        "channel": lambda row: channel_label(row["channel"]),
        "share of the gap": lambda row: percent_cell(row["share"], shaded=True),
        **{name.replace("_", " "): partial(_dependence_cell, name) for name in what},
        "band [Hz]": lambda row: " to ".join("–" if end is None else f"{end:.2g}" for end in row["band_hz"]),
    }
    return [
        "Before any effect is added. Each cell says what share of the channel's gap, on trials that were fitted, "
        "functions of that one thing would explain; several may look alike, and what does not hold on the trials "
        "that judge is no part of Where the gap goes. The band holds the middle 80 % of the gap's power.",
        columns_table(found["where"], columns),
    ]


def _dependence_cell(name: str, row: Document) -> Said:
    return percent_cell(row["dependence"].get(name), shaded=True)


# A trial as it was measured, and as the model tells it before and after the effects.

_SHOWN = 4


def show_curves(findings: Findings) -> Shown:
    """The channels with the largest shares of the gap: measured and modelled, and their difference."""
    found, data = findings.diagnosis, findings.data.gap
    if found is None or data is None:
        return ""
    order = [row["channel"] for row in found["where"] if row["channel"] in data.channels]
    shown, closed = (order or list(data.channels))[:_SHOWN], bool(found["effects"])
    lead = f"Trial {data.trial}: what was measured and what the model says, and the difference between them."
    if closed:
        lead += " With the effects, the blue difference should be no more than noise."
    if len(shown) < len(data.channels):
        lead += f" The {len(shown)} channels with the largest shares of the gap."
    panels = []
    for name in shown:
        i, label = data.channels.index(name), channel_label(name)
        measured, unit = data.measured[:, i], data.units[i]
        models = (
            ("the model", data.nominal, NOMINAL, True),
            ("with the effects", data.identified, IDENTIFIED, False),
        )
        lines = [Line(said, at[:, i], role, dashed) for said, at, role, dashed in models[: 1 + closed]]
        left = (Line(line.label, measured - line.values, line.role, line.dashed) for line in lines)
        panels.append(Panel(label, unit, (Line("measured", measured, INK), *lines)))
        panels.append(Panel(f"{label}, measured less modelled", unit, tuple(left)))
    return [lead, show_panels("curves", data.time, panels, "Measured and modelled, before and after")]


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


def show_effects(findings: Findings) -> Shown:
    """Accepted effects with their sizes, then what the first of them was preferred to."""
    found = findings.diagnosis
    if found is None or not (found["effects"] or found["candidates"]):
        return ""
    keyed = [((item["effect"], item["location"]), item) for item in (*found["effects"], *found["candidates"])]
    accepted = dict.fromkeys((key for key, _ in keyed[: len(found["effects"])]), "accepted")
    alike = [key for key, _ in keyed[len(found["effects"]) :]][: found["n_tied"]]
    standing = accepted | dict.fromkeys(alike, "as likely")
    kept = [one for k, one in enumerate(keyed) if k < len(found["effects"]) or one[0] not in accepted]
    rows = [{**item, "standing": standing.get(key, "tried")} for key, item in kept]
    tied = found["tied_locations"] if len(found["tied_locations"]) > 1 else []
    return [
        "Evidence is a log-likelihood ratio over effective samples, less the price of the parameters and of the "
        "candidates tried: e to that power is by how much an effect is likelier than none. "
        f"{describe_closed(of_positions(_channel_units(found['gap']))).capitalize()}."
        + ("" if found["effects"] else " None was accepted."),
        columns_table(rows, _EFFECTS),
        html_paragraph(f"Places that the record cannot tell apart: {', '.join(tied)}.") if tied else "",
    ]


def _format_sizes(parameters: Mapping[str, Document]) -> str:
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


def show_record(findings: Findings) -> Shown:
    """The next experiment, faults of the log and notes, each only where there is something to say."""
    found = findings.diagnosis
    if found is None:
        return ""
    content, following = [""], found["next_experiment"]
    if following is not None:
        motion = f" The motion is in {following['motion']}." if following["motion"] else ""
        content.append(html_paragraph(f"Next: {following['why']}{motion}"))
    if found["log"]:
        content.append("<h3>Faults of the record</h3>" + columns_table(found["log"], _FAULTS))
    said = {item["what"] for item in found["log"]}
    notes = [*found["warnings"], *(found["simulation"] or {"warnings": ()})["warnings"]]
    listed = "".join(f"<li>{escape(text)}</li>" for text in notes if text not in said)
    if listed:
        content.append(f"<h3>Limits</h3><ul>{listed}</ul>")
    return content if content[1:] else ""


# A diagnosis' held-out figures beside those of predictors that are far simpler than a simulator.

_PREDICTORS = {
    "model": "model",
    "command": "the command",
    "delayed_command": "delayed and scaled",
    "fir": "linear filter",
    "repeat": "a repeat",
}
_ANGLES = {"rad": "mrad", "m": "mm"}


def show_trivial(findings: Findings) -> Shown:
    """A row a channel: the model's error, then the command's, its delay's, a filter's, and what repeats differ by."""
    found = findings.diagnosis
    errors = {} if found is None else found["trivial"]
    shown = {k: v for k, v in _PREDICTORS.items() if any(item[k] is not None for item in errors.values())}
    if found is None or not shown.keys() - {"model"}:
        return ""
    rows = [
        item
        | {"unit": _ANGLES.get(item["unit"], str(item["unit"]))}
        | {key: _scale_value(item[key], 1e3 if item["unit"] in _ANGLES else 1.0) for key in shown}
        for item in named_rows(errors)
    ]
    columns: Columns = {"channel": lambda item: channel_label(item["name"]), "unit": "unit"}
    said = [item["message"] for item in found["findings"] if item["code"] == "no_better_than_trivial"]
    return [
        _trivial_lead(found, "fir" in shown),
        columns_table(rows, {**columns, **{title: key for key, title in shown.items()}}),
        *map(_note_paragraph, said),
    ]


def _trivial_lead(found: Document, of_commands: bool) -> str:
    rows = "Root mean square errors on the same rows of trials that were not fitted"
    if not of_commands:
        return (
            f"{rows}: what the model leaves, and by how much one trial's reading differs from another's with the same "
            "command. Both readings have noise of their own: a perfect model leaves 0.7 of that difference, and "
            "none leaves less."
        )
    simulation = found["simulation"] or {"before": {}}
    anew = (
        f", started anew from the record every {simulation['horizon_s']:g} s" if simulation["before"] else ""
    )
    return (
        f"{rows}. The model is the simulator with the effects found{anew}. The others know no physics: the command "
        "itself; the command some time ago, scaled and offset; a linear filter of the command; another trial with the "
        "same command. What they had to learn they learnt on the trials to learn from. A model that is no better than "
        "these explains nothing that a delay does not."
    )


# What is wrong with a log, worst first, and what was done or is to be done about it.

_MEANS = {
    "fatal": "nothing can be told",
    "spoils": "spoils what is computed",
    "limits": "limits what can be told",
    "note": "to know",
}


def show_log_findings(findings: Findings) -> Shown:
    """A row a finding."""
    found = findings.doctor
    if found is None:
        return ""
    if not found["findings"]:
        return [
            "Rows, clock, units, signs, order of columns, zeros, dead and clipped channels: nothing is wrong."
        ]
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
    return [lead, columns_table(found["findings"], columns)]


def _finding_place(item: Document) -> str:
    trials = f"in {list_names(item['trials'], 4)}" if item["trials"] else ""
    return "; ".join(filter(None, (list_names(item["places"], 4), trials)))
