"""A diagnosis in a row of key figures."""

from __future__ import annotations

from collections.abc import Iterator

from excite.report.folder import Document, Findings
from excite.report.html import tile
from excite.report.sections.answer import VERDICTS
from excite.report.sections.section import Section

# An interval that begins below this part of the share closed contradicts it at first sight.
_SURE = 0.5


class Verdict(Section):
    """The gap before and after, how far it closes, what roll-outs say."""

    identifier = "verdict"
    title = ""

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        found = findings.diagnosis
        if found is None:
            return ""
        return f'<div class="tiles" id="{self.identifier}">{"".join(_tiles(found))}</div>'


def _tiles(found: Document) -> Iterator[str]:
    verdict, gap = found["verdict"], found["gap"]
    yield tile(verdict, VERDICTS[verdict])
    closed = bool(found["effects"])
    size = f"{_percent(gap['before'])} → {_percent(gap['after'])}" if closed else _percent(gap["before"])
    yield tile(size, f"of the signal is not explained; {_percent(gap['noise_floor'])} is noise")
    if closed:
        bounds = gap["share_closed_90"]
        within = f"; 90 % interval {_whole(bounds[0])} to {_whole(bounds[1])} %" if bounds else ""
        if bounds and None not in bounds and bounds[0] < _SURE * (gap["share_closed"] or 0.0):
            within += ": so much is closed on the trials that judge, which are too few or too short to say it of others"
        yield tile(f"{_whole(gap['share_closed'])} %", "of the gap above the noise is closed" + within)
    rollouts = found["simulation"]
    if closed and rollouts and rollouts["before"]:
        ratios = sorted(_ratios(rollouts["before"], rollouts["after"]))
        label = (
            f"of the error of {rollouts['horizon_s']:g} s roll-outs is left with the effects, median channel"
        )
        if ratios:
            yield tile(f"{_whole(ratios[len(ratios) // 2])} %", label)


def _ratios(before: Document, after: Document) -> list[float]:
    """Errors after over those before, of the channels in which both are known and there was one."""
    both = ((before[name], after[name]) for name in before)
    return [now / was for was, now in both if was and now is not None]


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100.0 * share:.3g} %"


def _whole(share: float | None) -> str:
    return "–" if share is None else f"{100.0 * share:.0f}".replace("-", "−")
