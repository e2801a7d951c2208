"""The page of diagnoses of real robots."""

from __future__ import annotations

from collections.abc import Sequence

from excite.diagnosis.answer.candidate import Candidate, format_estimate, in_words
from tests.reproduction.real_robots.entry import Bar, Entry, said

_HEAD = """# Diagnoses of real robots

What `excite.diagnose` says of public recordings of real machines, beside what their publications say. Written by
`python -m tests.reproduction.real_robots --write`, which needs the recordings; none of their data is kept here.

Gaps are root mean squares, over joints, of measured minus predicted torque on trials that were not fitted, in percent
of the torque's standard deviation. Evidence is in nats: a log-likelihood ratio over effective samples, less the price
of the parameters and of the candidates tried. A tick is something known from elsewhere that the diagnosis says too, a
cross something known from elsewhere that it misses. In brackets stand bars of this project that no publication states.
"""
_LISTED = 4


def page(entries: Sequence[Entry]) -> str:
    """The page in Markdown."""
    rows = ["| recording | diagnosis | gap before → after | where it shrinks most | known |"]
    rows.append("| --- | --- | --- | --- | --- |")
    for entry in entries:
        marks = " ".join(bar.mark for bar in entry.bars)
        cells = (entry.title, said(entry.diagnosis), _gap(entry), _shrunk(entry), marks)
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join([_HEAD, *rows, "", *(section(entry) for entry in entries)])


def section(entry: Entry) -> str:
    """One recording."""
    d = entry.diagnosis
    lines = [f"## {entry.title}", "", f"{entry.source} {entry.trials}", ""]
    lines += [f"- **Model:** {entry.baseline}", f"- **Known:** {entry.known}"]
    lines += [f"- **Verdict:** {d.verdict}. {d.sentence()}", f"- **Gap:** {_gap(entry)}{_interval(entry)}"]
    if d.verdict == "unknown" and d.candidates:
        best = max(d.candidates, key=lambda item: item.evidence)
        lines.append(
            f"- **Likeliest of what was tried:** {in_words(best.effect, best.location)}, {best.evidence:.0f} nats; too "
            "much is left with it to call it the cause."
        )
    if entry.remark:
        lines.append(f"- **Support:** {entry.remark}")
    if d.next_experiment is not None:
        lines.append(f"- **Next:** {d.next_experiment.why}.")
    lines += ["", *_candidates(entry), "", *_channels(entry), ""]
    lines += [f"{bar.mark} {bar.what}: {bar.reached}{_why(bar)}  " for bar in entry.bars]
    if entry.picture is not None:
        file, text = entry.picture
        lines += ["", f"![{text}](images/{file})"]
    return "\n".join([*lines, ""])


def _gap(entry: Entry) -> str:
    gap = entry.diagnosis.gap
    return f"{100 * gap.before:.1f} → {100 * gap.after:.1f} % (floor {100 * gap.noise_floor:.1f} %)"


def _shrunk(entry: Entry) -> str:
    """The joint whose gap shrinks most."""
    if not entry.diagnosis.effects:
        return ""
    gaps = entry.diagnosis.gap.per_channel
    name = min(gaps, key=lambda joint: gaps[joint].after / max(gaps[joint].before, 1e-300))
    return f"{name} {gaps[name].before:.3g} → {gaps[name].after:.3g} {gaps[name].unit}"


def _interval(entry: Entry) -> str:
    gap = entry.diagnosis.gap
    if gap.interval is None:
        return "."
    low, high = gap.interval
    return f"; {100 * gap.share_closed:.0f} % of it closed (90 %: {100 * low:.0f} to {100 * high:.0f} %)."


def _why(bar: Bar) -> str:
    """Why a bar is missed, where that is known."""
    return f" ({bar.reason})" if bar.reason and not bar.met else ""


def _candidates(entry: Entry) -> list[str]:
    """Accepted effects, then the likeliest of the others."""
    d = entry.diagnosis
    accepted = {(item.effect, item.location) for item in d.effects}
    others = [item for item in d.candidates if (item.effect, item.location) not in accepted]
    shown = [*d.effects, *others[: max(_LISTED - len(d.effects), 2)]]
    rows = ["| effect | place | parameters | evidence | |", "| --- | --- | --- | ---: | --- |"]
    tied = {(item.effect, item.location) for item in d.ambiguous_with}
    for item in shown:
        key = (item.effect, item.location)
        role = "tied" if key in tied else "accepted" if key in accepted else "tried"
        rows.append(
            f"| {item.effect.replace('_', ' ')} | {item.location} | {_values(item)} | {item.evidence:.0f} | {role} |"
        )
    return rows


def _values(item: Candidate) -> str:
    values = [f"{name.replace('_', ' ')} {format_estimate(value)}" for name, value in item.parameters.items()]
    return ", ".join(values[:4])


def _channels(entry: Entry) -> list[str]:
    d = entry.diagnosis
    follows = {item.channel: item.depends_on for item in d.where}
    rows = ["| joint | before | after | floor | before, it follows |", "| --- | ---: | ---: | ---: | --- |"]
    for name, gap in d.gap.per_channel.items():
        values = " | ".join(f"{value:.3g} {gap.unit}" for value in (gap.before, gap.after, gap.noise_floor))
        rows.append(f"| {name} | {values} | {follows.get(name, '')} |")
    return rows
