"""Sections of the page of a diagnosis."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from excite.diagnosis.answer.answer import HELD, doubt_of_share, left_elsewhere, named_beside_closed
from excite.diagnosis.answer.budget import NOT_REPEATED
from excite.diagnosis.answer.gap import of_positions
from excite.display import span
from excite.report.comparisons import ForceComparison
from excite.report.conclusions import VERDICTS
from excite.report.folder import Document, Findings
from excite.report.html import (
    Cell,
    folded_content,
    format_number,
    html_paragraph,
    html_table,
    inline_figure,
    key_figure,
    live_chart,
)
from excite.report.plots.forces import MOST_PANELS, channel_label, plot_forces
from excite.report.sections.section import Content, section, section_content
from excite.report.theme import IDENTIFIED, INK, PALE, WIDTH_IN, draw_figure, shorten_name, to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The gap of each channel against its noise floor, before and after the effects.


@section("gap", "Gap by channel")
def show_gap_by_channel(findings: Findings) -> Content | str:
    """Bars from the noise floor upwards; the numbers, with those of roll-outs."""
    found = findings.diagnosis
    if found is None:
        return ""
    channels = found["gap"]["per_channel"]
    closed = bool(found["effects"])
    lead = (
        "What the model leaves on trials that were not fitted, as a multiple of the noise floor: bars that end at "
        "the line leave nothing to explain."
    )
    svg = to_svg(plot_gap(channels, closed), "gap", "Gap of each channel over its noise floor")
    rows: list[tuple[Cell, ...]] = [
        (name, item["unit"], item["before"], item["after"] if closed else None, item["noise_floor"])
        for name, item in channels.items()
    ]
    numbers = folded_content(
        "Numbers", html_table(("channel", "unit", "before", "after", "noise floor"), rows)
    )
    return section_content(
        lead,
        inline_figure(svg),
        numbers,
        _rollout_sentence(found["simulation"]),
    )


def _rollout_sentence(simulation: dict | None) -> str:
    if simulation is None or not simulation["before"]:
        return ""
    after, floor = simulation["after"], simulation["floor"]
    rows: list[tuple[Cell, ...]] = [
        (name, _times_thousand(before), _times_thousand(after[name]), _times_thousand(floor.get(name)))
        for name, before in simulation["before"].items()
    ]
    how = f"{simulation['horizon_s']:g} s, driven by {simulation['driven_by']}"
    summary = f"Roll-outs of {how}: errors [mrad or mm]"
    return folded_content(summary, html_table(("channel", "before", "after", "what noise alone makes"), rows))


def _times_thousand(value: float | None) -> float | None:
    return None if value is None else 1e3 * value


# Gaps of channels over their noise floors.

_DRAWN = ("before", "after", "noise_floor")
# Least noise floor, and largest multiple of it, that an axis can show.
_LEAST, _MOST = 1e-200, 1e200
_TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


def plot_gap(channels: Mapping[str, Mapping[str, Any]], closed: bool) -> Figure:
    """A bar a channel from the noise floor to the gap, on a logarithmic scale; a narrow one with the effects.

    Args:
        channels: by name, ``before``, ``after`` and ``noise_floor``, in one unit.
        closed: whether there are effects, so that ``after`` says something.
    """
    names = list(channels)
    # A value that is not known is NaN, and its bar is not drawn.
    values = {key: np.array([c[key] for c in channels.values()], dtype=float) for key in _DRAWN}
    floor = np.maximum(values["noise_floor"], _LEAST)
    before, after = (np.clip(values[key] / floor, 1.0, _MOST) for key in ("before", "after"))
    rows = np.arange(len(names))

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        axes.barh(rows, before - 1.0, 0.72, left=1.0, color=PALE.light, label="the model")
        if closed:
            axes.barh(rows, after - 1.0, 0.34, left=1.0, color=IDENTIFIED.light, label="with the effects")
        axes.axvline(1.0, color=INK.light, lw=1.2)
        most = float(np.nanmax([*before, *after, 2.0]))
        axes.set_xscale("log")
        axes.set_xlim(0.97, 1.6 * most)
        ticks = [tick for tick in _TICKS if tick <= 1.6 * most]
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        axes.minorticks_off()
        axes.set_yticks(rows, [shorten_name(channel_label(name)) for name in names])
        axes.tick_params(axis="y", length=0)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("gap over its noise floor (no unit, log scale)")
        for row, (was, now) in enumerate(zip(before, after, strict=True)):
            if np.isnan(was) or (closed and np.isnan(now)):
                continue
            text = f"{was:.3g} → {now:.3g}" if closed else f"{was:.3g}"
            axes.annotate(
                text,
                (max(was, now if closed else was), row),
                (5, 0),
                textcoords="offset points",
                va="center",
                fontsize=7.5,
            )
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)

    return draw_figure(paint, height_in=1.0 + 0.24 * len(names), width_in=WIDTH_IN)


# What the gap is counted from: sizes that the model took from the record before the first effect was asked
# for.

_BODIES = {
    "rigid_body": "The bodies' base parameters were fitted to this record, too.",
    "rigid_body_fixed": "The bodies are as the model has them.",
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
    headers = ("joint", "parameter", "value", "±", "90 % interval", "unit")
    return section_content(
        lead,
        html_table(headers, [_baseline_row(item) for item in found["baseline"]]),
        *bodies,
    )


def _baseline_row(item: Document) -> tuple[Cell, ...]:
    bounds = item["interval90"]
    between = "–" if bounds is None else span(format_number(bounds[0]), format_number(bounds[1]), " to ")
    name = item["parameter"].replace("_", " ")
    return item["joint"], name, item["value"], item["std"], between, item["unit"]


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


def _render_channel(name: str, channel: Document) -> str:
    """A channel's heading, bar and table."""
    parts = list(_channel_parts(channel))
    floor, gap = format_number(channel["noise_floor"]), format_number(channel["gap"])
    unit = channel["unit"]
    size = (
        f"gap {gap} {unit}, noise floor {floor} {unit}, {_percent_text(channel['weight'])} of the whole gap"
    )
    rows = "".join(
        f"<tr><td>{escape(part.what)}</td><td class='number'>{_percent_text(part.share)}</td>"
        f"<td>{_interval_text(part)}</td><td>{escape(_part_doubt(part))}</td></tr>"
        for part in parts
    )
    head = "<tr><th>part</th><th class='number'>share</th><th>90 % interval</th><th></th></tr>"
    return (
        f'<h3>{escape(channel_label(name))}</h3><p class="lead">{escape(size)}</p>{_stacked_bar(parts)}'
        f'<div class="wide"><table><thead>{head}</thead><tbody>{rows}</tbody></table></div>'
    )


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
        f'title="{escape(part.what)} {_percent_text(part.share)}"></span>'
        for part, size in zip(parts, sizes, strict=True)
        if size > 0.0
    )
    said = escape("; ".join(f"{part.what} {_percent_text(part.share)}" for part in parts))
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
    said = [f"{_percent_text(part.share)} {_part_verb(part)}" for part in large[:_SAID]]
    listed = ", ".join([*said, f"{_percent_text(rest.share)} is {'the rest' if said else 'without a name'}"])
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
    closed = found["gap"]["share_closed"]
    named = sum(
        (channel["weight"] or 0.0) * sum(item["share"] or 0.0 for item in channel["effects"])
        for _, channel in order
    )
    said = named_beside_closed(named, closed, accepted=bool(found["effects"]))
    return html_paragraph(f"{said[0].upper()}{said[1:]}.", "note") if said else ""


def _explain_elsewhere(found: Document) -> str:
    """Why the gap by channel lies at another joint, where it does."""
    gaps = {name: (item["before"], item["noise_floor"]) for name, item in found["gap"]["per_channel"].items()}
    weights = {name: item["weight"] or 0.0 for name, item in found["budget"].items()}
    said = left_elsewhere(gaps, weights, found["modelled"])
    return html_paragraph(f"{said[0].upper()}{said[1:]}.", "note") if said else ""


def _part_doubt(part: _Part) -> str:
    """Why its share and its interval do not seem to fit each other."""
    return "" if part.interval is None else doubt_of_share(part.share, *part.interval)


def _interval_text(part: _Part) -> str:
    if part.interval is None:
        return "–"
    return span(_percent_text(part.interval[0]), _percent_text(part.interval[1]), " to ")


def _percent_text(share: float | None) -> str:
    if share is None:
        return "–"
    text = f"{100.0 * share:.0f} %".replace("-", "−")
    return "0 %" if text == "−0 %" else text


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
    verdict, gap = found["verdict"], found["gap"]
    yield key_figure(verdict, VERDICTS[verdict])
    closed = bool(found["effects"])
    size = (
        f"{_verdict_percent_text(gap['before'])} → {_verdict_percent_text(gap['after'])}"
        if closed
        else _verdict_percent_text(gap["before"])
    )
    yield key_figure(
        size, f"of the signal is not explained; {_verdict_percent_text(gap['noise_floor'])} is noise"
    )
    if closed:
        bounds = gap["share_closed_90"]
        within = (
            f"; 90 % interval {span(_whole_percent(bounds[0]), _whole_percent(bounds[1]), ' to ')} %"
            if bounds
            else ""
        )
        if bounds and None not in bounds and bounds[0] < _SURE * (gap["share_closed"] or 0.0):
            within += ": so much is closed on the trials that judge, which are too few or too short to say it of others"
        units = (item["unit"] for item in gap["per_channel"].values())
        of = "gap of the positions" if of_positions(units) else "gap"
        yield key_figure(
            f"{_whole_percent(gap['share_closed'])} %", f"of the {of} above the noise is closed" + within
        )
    rollouts = found["simulation"]
    if closed and rollouts and rollouts["before"]:
        share = rollout_share(rollouts)
        how = f"of the error above noise of {rollouts['horizon_s']:g} s roll-outs is mended"
        if share is None:
            how = (
                f"roll-outs of {rollouts['horizon_s']:g} s err by no more than noise makes: they cannot tell"
            )
        yield key_figure(f"{_whole_percent(share)} %" if share is not None else "–", how)


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
        f"{_whole_percent(closed)} % and {_whole_percent(share)} % are both right. The first is what "
        "the effects explain of the "
        f"readings, instant by instant; the second what they mend of where the simulator goes on its own for "
        f"{rollouts['horizon_s']:g} s: {why}.",
        "note",
    )


def _verdict_percent_text(share: float | None) -> str:
    return "–" if share is None else f"{100.0 * share:.3g} %"


def _whole_percent(share: float | None) -> str:
    return "–" if share is None else f"{100.0 * share:.0f}".replace("-", "−")


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
    what = list(dict.fromkeys(name for row in found["where"] for name in row["dependence"]))
    head = "".join(
        f"<th>{escape(text)}</th>"
        for text in (
            "channel",
            "share of the gap",
            *(name.replace("_", " ") for name in what),
            "band [Hz]",
        )
    )
    body = "".join(_where_row(row, what) for row in found["where"])
    map_ = f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
    return section_content(lead, map_)


def _where_row(row: dict, what: list[str]) -> str:
    band = " to ".join("–" if end is None else f"{end:.2g}" for end in row["band_hz"])
    cells = "".join(_shaded_share(row["dependence"].get(name)) for name in what)
    return (
        f"<tr><td>{escape(channel_label(row['channel']))}</td>{_shaded_share(row['share'])}{cells}"
        f"<td>{band}</td></tr>"
    )


def _shaded_share(share: float | None) -> str:
    if share is None:
        return '<td class="map">–</td>'
    depth = round(60.0 * min(max(share, 0.0), 1.0))
    colour = f"color-mix(in srgb, var(--identified) {depth}%, transparent)"
    return f'<td class="map" style="background: {colour}">{100.0 * share:.0f} %</td>'


# Sections of the page of a log that was looked through.

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
