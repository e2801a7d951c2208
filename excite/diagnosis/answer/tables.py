"""The tables of a diagnosis in words, for a terminal: the gap by channel, and effects with their rivals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from excite.diagnosis.answer.budget import Budget
from excite.diagnosis.answer.budget_doubts import HELD, doubt_of_share, left_elsewhere, named_beside_closed
from excite.diagnosis.answer.candidate import Candidate, in_words, measured, sized
from excite.diagnosis.answer.gap import Gap, Where
from excite.diagnosis.answer.trivial import TrivialErrors
from excite.finding import Finding
from excite.shown import span

# Share of a channel's gap from which it is said to follow something.
_FOLLOWS = 0.3
# How the words end that say what an unknown gap is like.
NO_NAME = "no effect in the library stands for that"
_LISTED = 6
_BODIES = {
    "rigid_body": "its bodies fitted to this record (write rigid_body_fixed under modelled in log.yaml to take them as "
    "the model has them)",
    "rigid_body_fixed": "its bodies as the model has them",
}


def baseline_lines(modelled: Sequence[str]) -> list[str]:
    """What the gap is counted from: what of the model was fitted to the record, and what was taken from its file."""
    bodies = [text for name, text in _BODIES.items() if name in modelled]
    fitted = [name.replace("_", " ") for name in modelled if name not in _BODIES]
    also = [f"{', '.join(fitted)} fitted at every joint"] if fitted else []
    return [f"counted from the model with {'; '.join([*bodies, *also])}"] if modelled else []


def gap_table(gap: Gap, where: Sequence[Where]) -> list[str]:
    """Lines with the gap by channel before and after, its noise floor, its share and what it depends on."""
    share = {item.channel: item for item in where}
    width = max([len(name) for name in gap.per_channel] + [7])
    lines = [f"{'channel':{width}}  {'before':>9}  {'after':>9}  {'floor':>9}  share  depends on"]
    for name, item in gap.per_channel.items():
        place = share.get(name)
        tail = "" if place is None else f"  {100 * place.share:4.0f}%  {place.depends_on}"
        lines.append(
            f"{name:{width}}  {item.before:9.3g}  {item.after:9.3g}  {item.noise_floor:9.3g}{tail} [{item.unit}]"
        )
    total = f"{gap.before:9.3g}  {gap.after:9.3g}  {gap.noise_floor:9.3g}"
    return [*lines, f"{'all':{width}}  {total}  (of the signal)"]


def budget_lines(budget: Budget, gap: Gap, modelled: Sequence[str], *, accepted: bool) -> list[str]:
    """The budget in one sentence and as a table, and why it has other figures than stand before it, where it has."""
    gaps = {name: (item.before, item.noise_floor) for name, item in gap.per_channel.items()}
    named = sum(item.share for item in budget.named)
    beside = named_beside_closed(named, gap.share_closed, accepted=accepted)
    said = [text for text in (beside, left_elsewhere(gaps, budget.weights, modelled)) if text]
    return [budget.sentence(), *_budget_table(budget), *(f"({text})" for text in said)]


def _budget_table(budget: Budget) -> list[str]:
    """Lines with what takes which share of each channel's gap, and the rest; below, what its intervals leave open."""
    notes: dict[str, str] = {}
    width = max([len(name) for name in budget.channels] + [7])
    lines = [f"{'channel':{width}}  share        90 %  of the gap above the noise"]
    for name, channel in budget.channels.items():
        if channel.weight == 0.0 and not channel.effects and not channel.unnamed:
            lines.append(f"{name:{width}}  {'–':>5}  {'':10}  nothing stands above its noise")
            continue
        for item in channel.effects:
            low, high = item.interval90
            between = f"{span(_whole(low), _whole(high), '…')}%" if math.isfinite(low + high) else ""
            what = in_words(item.effect, item.location)
            doubt = doubt_of_share(item.share, *item.interval90)
            mark = f" {notes.setdefault(doubt, f'[{len(notes) + 1}]')}" if doubt else ""
            lines.append(f"{name:{width}}  {_whole(item.share):>4}%  {between:>10}  {what}{mark}")
        for other in channel.unnamed:
            what = other.follows if not other.knots else f"follows {other.follows}, without a name"
            lines.append(f"{name:{width}}  {_whole(other.share):>4}%  {'':10}  {what}")
        lines.append(f"{name:{width}}  {_whole(channel.rest):>4}%  {'':10}  the rest")
    held = [f"({HELD})"] if any(channel.effects for channel in budget.channels.values()) else []
    return [*lines, *(f"{mark} {doubt}" for doubt, mark in notes.items()), *held]


def _whole(share: float) -> str:
    """A share in per cent, without a sign before zero."""
    return f"{round(100.0 * share):d}" if math.isfinite(share) else f"{share:.0f}"


def budget_rows(budget: Budget) -> list[dict[str, Any]]:
    """A row for each share of each channel's gap above its noise floor; the shares of a channel add up to one."""
    rows: list[dict[str, Any]] = []
    for name, channel in budget.channels.items():
        for item in channel.effects:
            low, high = item.interval90
            what = {"effect": item.effect, "location": item.location, "follows": None}
            rows.append({"channel": name, **what, "share": item.share, "low90": low, "high90": high})
        rest = [(other.follows, other.share) for other in channel.unnamed] + [("the rest", channel.rest)]
        for follows, share in rest:
            what = {"effect": None, "location": None, "follows": follows}
            rows.append({"channel": name, **what, "share": share, "low90": None, "high90": None})
    return rows


def candidate_row(item: Candidate, accepted: set[tuple[str, str | None]]) -> dict[str, Any]:
    """A row of the table of candidates."""
    return {
        "effect": item.effect,
        "location": item.location,
        "accepted": (item.effect, item.location) in accepted,
        "evidence": item.evidence,
        "share_closed": item.share_closed,
        "probability": item.probability,
        "parameters": ", ".join(
            f"{name} {one.value:.4g} {one.unit}".removesuffix(" 1") for name, one in item.parameters.items()
        ),
    }


def trivial_table(errors: Mapping[str, TrivialErrors]) -> list[str]:
    """Lines with the model's error beside those of simple predictors; none where there are no such ones."""
    names = ("model", "command", "delayed_command", "fir", "repeat")
    rows = {name: [item.to_json()[n] for n in names] for name, item in errors.items()}
    if all(value is None for row in rows.values() for value in row[1:]):
        return []
    width = max([len(name) for name in errors] + [7])
    heads = ("model", "command", "delayed", "filter", "repeat")
    lines = ["", f"{'channel':{width}}  " + "  ".join(f"{h:>8}" for h in heads) + "  RMSE on what judges"]
    for name, row in rows.items():
        values = "  ".join(f"{'' if v is None else format(v, '.3g'):>8}" for v in row)
        lines.append(f"{name:{width}}  {values}  [{errors[name].unit}]")
    return lines


def in_a_row(each: Sequence[str]) -> str:
    """Words with commas between them and ``and`` before the last."""
    return " and ".join([", ".join(each[:-1]), each[-1]] if len(each) > 1 else each)


def without_a_name(place: str, where: Sequence[Where], warnings: Sequence[str]) -> str:
    """An unknown gap in words: what it is like, where that is known, or what it follows."""
    like = next((text for text in warnings if text.endswith(NO_NAME)), None)
    follows = "".join(
        f" follows {item.depends_on} and that"
        for item in where
        if item.channel == place and item.dependence.get(item.depends_on, 0.0) >= _FOLLOWS
    )
    return like or f"there is a gap at {place} that{follows} no effect in the library explains"


def either_of(effects: Sequence[Candidate], ambiguous_with: Sequence[Candidate]) -> tuple[str, bool]:
    """Effects that cannot be told apart, in words, behind accepted ones that are sure; and whether there are such."""
    open_ = {(item.effect, item.location) for item in ambiguous_with}
    sure = [sized(item) for item in effects if (item.effect, item.location) not in open_]
    either = " or ".join(sized(item) for item in ambiguous_with)
    return (f"{in_a_row(sure)}, and {either}", True) if sure else (either, False)


def effect_table(
    effects: Sequence[Candidate], candidates: Sequence[Candidate], ambiguous_with: Sequence[Candidate]
) -> list[str]:
    """Lines with accepted effects in their order, then what the first one was preferred to.

    Args:
        effects: the accepted ones.
        candidates: all that were compared, likeliest first.
        ambiguous_with: candidates that the data cannot tell apart.
    """
    named = {(item.effect, item.location) for item in effects}
    rivals = [item for item in candidates if (item.effect, item.location) not in named]
    open_ = {(item.effect, item.location) for item in ambiguous_with}
    listed = [*effects, *rivals][: max(_LISTED, len(effects) + len(open_))]
    if not listed:
        return []
    lines = [f"{'effect':24} {'place':24} {'':9} {'evidence':>9} {'closed':>7}  parameters"]
    for item in listed:
        key = (item.effect, item.location)
        standing = "as likely" if key in open_ else "accepted" if key in named else "tried"
        lines.append(_line(item, standing))
    return lines


def _line(item: Candidate, standing: str) -> str:
    values = ", ".join(f"{name} {measured(e)}" for name, e in item.parameters.items())
    return (
        f"{item.effect:24} {item.location or '':24} {standing:9} {item.evidence:9.1f} "
        f"{100 * item.share_closed:6.0f}%  {values}"
    )


def fault_lines(faults: Sequence[Finding]) -> list[str]:
    """One line a finding of the doctor."""
    return [f"log: {item.text} ({item.remedy}{'; repaired' if item.repaired else ''})" for item in faults]


def fault_entry(item: Finding) -> dict[str, Any]:
    """A finding in the form of the document's ``log``."""
    return {
        "kind": item.kind,
        "where": item.where,
        "what": item.text,
        "cause": item.remedy,
        "repaired": item.repaired,
    }
