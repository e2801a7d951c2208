"""A diagnosis in words and tables, for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from excite.diagnosis.answer.candidate import Candidate, measured
from excite.diagnosis.answer.result import Diagnosis
from excite.finding import Finding

_LISTED = 6


def summary_of(diagnosis: Diagnosis) -> str:
    """The sentence, the gap by channel, effects and rivals, what to do next, faults of the record, limits."""
    lines = [diagnosis.sentence(), ""]
    if len(diagnosis.tied_locations) > 1:
        lines += [f"places that cannot be told apart: {', '.join(diagnosis.tied_locations)}", ""]
    lines += [*_gap_lines(diagnosis), "", *_effect_lines(diagnosis)]
    if diagnosis.next_experiment is not None:
        lines += ["", f"next: {diagnosis.next_experiment.why}"]
    lines += _fault_lines(diagnosis.faults)
    lines += [f"note: {text}" for text in diagnosis.warnings]
    return "\n".join(lines)


def _gap_lines(diagnosis: Diagnosis) -> list[str]:
    gap, share = diagnosis.gap, {item.channel: item for item in diagnosis.where}
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


def _effect_lines(diagnosis: Diagnosis) -> list[str]:
    """Accepted effects in their order, then what the first one was preferred to."""
    named = {(item.effect, item.location) for item in diagnosis.effects}
    rivals = [item for item in diagnosis.candidates if (item.effect, item.location) not in named]
    open_ = {(item.effect, item.location) for item in diagnosis.ambiguous_with}
    listed = [*diagnosis.effects, *rivals][: max(_LISTED, len(diagnosis.effects) + len(open_))]
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


def _fault_lines(faults: Sequence[Finding]) -> list[str]:
    """One line a finding of the doctor."""
    return [f"log: {item.text} ({item.remedy}{'; repaired' if item.repaired else ''})" for item in faults]
