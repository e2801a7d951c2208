"""A diagnosis in a row of key figures."""

from __future__ import annotations

from collections.abc import Iterator

from excite.diagnosis.answer.gap import of_positions
from excite.report.conclusions.diagnosed import VERDICTS
from excite.report.folder import Document, Findings
from excite.report.html import html_paragraph, key_figure
from excite.report.sections.section import Section
from excite.shown import span

# An interval that begins below this part of the share closed contradicts it at first sight.
_SURE = 0.5
# A roll-out's error below this multiple of what noise alone makes is as good as noise: where a diagnosis finds nothing,
# channels of an arm err by 0.9 to 2.6 times it and those of a humanoid by 0.9 to 1.7; with a payload by 80 and more.
_NOISE = 3.0
# Shares that differ by more are worth a word.
_DIFFERS = 0.15


class Verdict(Section):
    """The gap before and after, how far it closes, what roll-outs say."""

    identifier = "verdict"
    title = ""

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        found = findings.diagnosis
        if found is None:
            return ""
        return f'<div class="tiles" id="{self.identifier}">{"".join(_verdict_tiles(found))}</div>{_explain_disagreement(found)}'


def _verdict_tiles(found: Document) -> Iterator[str]:
    verdict, gap = found["verdict"], found["gap"]
    yield key_figure(verdict, VERDICTS[verdict])
    closed = bool(found["effects"])
    size = (
        f"{_percent_text(gap['before'])} → {_percent_text(gap['after'])}"
        if closed
        else _percent_text(gap["before"])
    )
    yield key_figure(size, f"of the signal is not explained; {_percent_text(gap['noise_floor'])} is noise")
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
        f"{_whole_percent(closed)} % and {_whole_percent(share)} % are both right. The first is what the effects explain of the "
        f"readings, instant by instant; the second what they mend of where the simulator goes on its own for "
        f"{rollouts['horizon_s']:g} s: {why}.",
        "note",
    )


def _percent_text(share: float | None) -> str:
    return "–" if share is None else f"{100.0 * share:.3g} %"


def _whole_percent(share: float | None) -> str:
    return "–" if share is None else f"{100.0 * share:.0f}".replace("-", "−")
