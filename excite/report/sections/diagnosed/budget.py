"""Where each channel's gap goes: noise floor, named effects with their intervals, unnamed shares, the rest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from html import escape

from excite.diagnosis.answer.budget import NOT_REPEATED
from excite.diagnosis.answer.budget_doubts import HELD, doubt_of_share, left_elsewhere, named_beside_closed
from excite.report.folder import Document, Findings
from excite.report.html import folded_content, format_number, html_paragraph, html_section
from excite.report.plots.forces import channel_label
from excite.report.sections.section import Section
from excite.shown import span

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


class BudgetByChannel(Section):
    """A sentence, a stacked bar and a table for each channel, the largest part of the gap first."""

    identifier = "budget"
    title = "Where the gap goes"

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
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
            return html_section(self.identifier, self.title, lead, every)
        lead = _channel_sentence(*order[0])
        how = (
            "Shares are of the power above the noise floor on trials that were not fitted, all effects taken together; "
            "those of a channel add up to one. An interval says what a share would be on other stretches of such a "
            "record: blocks of it were left out in turn. Instants at which a joint stands or turns round count for "
            "next to nothing here, so that gap and noise floor are other numbers than under Gap by channel, where each "
            f"instant counts. The {HELD}."
        )
        rest = (
            folded_content(f"Joints with less than {100 * _SMALL:.0f} % of the whole gap", small)
            if small
            else ""
        )
        beside = _explain_difference(found, order) + _explain_elsewhere(found)
        return html_section(
            self.identifier, self.title, lead, html_paragraph(how), beside, _bar_legend(), large, rest
        )


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
    size = f"{format_number(channel['gap'], 2)} {channel['unit']} above {format_number(channel['noise_floor'], 2)} noise"
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
