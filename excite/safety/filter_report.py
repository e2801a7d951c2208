"""What became of candidates: each, and all of them counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.safety.refusals import RefusalTally, Refused, joined_refusals
from excite.safety.repairs.draft import Rejection
from excite.safety.verdict import Verdict


@dataclass(frozen=True, eq=False)
class FilterOutcome:
    """What became of one candidate.

    Attributes:
        candidate: its name.
        seconds: processor time that it took [s].
        motion: the motion, None if rejected or handed to ``keep``.
        verdict: the independent verdict, None if no motion came out of the repairs.
        rejection: why it was rejected, None if accepted.
        kept: what ``keep`` made of an accepted motion.
    """

    candidate: str
    seconds: float
    motion: Motion | None = None
    verdict: Verdict | None = None
    rejection: Rejection | None = None
    kept: Any = None


@dataclass(frozen=True, eq=False)
class FilterReport:
    """What became of all candidates, in their order.

    Attributes:
        outcomes: one per candidate; none where accepted motions were handed to ``keep``, so that memory does not grow
            with the number of candidates.
        kept: what ``keep`` made of the accepted motions.
        generated: number of candidates.
        rejected: number of rejected candidates by reason, the commonest first.
        seconds: processor time of all candidates and processes [s].
        refused: what refuses them, by pair of links, joint, contact or limit, the commonest first.
        interrupted: whether somebody broke off before all candidates were judged.
    """

    outcomes: tuple[FilterOutcome, ...]
    kept: tuple[Any, ...]
    generated: int
    rejected: dict[str, int]
    seconds: float
    refused: tuple[Refused, ...] = ()
    interrupted: bool = False

    @property
    def motions(self) -> tuple[Motion, ...]:
        """The accepted motions, but for those handed to ``keep``."""
        return tuple(o.motion for o in self.outcomes if o.motion is not None)

    def joined(self, more: FilterReport) -> FilterReport:
        """The report of these candidates and of ``more`` after them."""
        return FilterReport(
            outcomes=(*self.outcomes, *more.outcomes),
            kept=(*self.kept, *more.kept),
            generated=self.generated + more.generated,
            rejected=_commonest_first(Counter(self.rejected) + Counter(more.rejected)),
            seconds=self.seconds + more.seconds,
            refused=joined_refusals(self.refused, more.refused),
            interrupted=self.interrupted or more.interrupted,
        )


def count_outcomes(
    robot: Robot, outcomes: Iterable[FilterOutcome], *, whole: bool, partial: bool = False
) -> FilterReport:
    """Count outcomes as they come; they are held where the report is to be ``whole``.

    Where a ``partial`` report will do, a user's interrupt ends it with what had been counted by then.
    """
    held: list[FilterOutcome] = []
    kept: list[Any] = []
    reasons, tally = Counter[str](), RefusalTally(robot)
    generated, seconds, interrupted = 0, 0.0, False
    try:
        for outcome in outcomes:
            generated, seconds = generated + 1, seconds + outcome.seconds
            if outcome.rejection is not None:
                reasons[outcome.rejection.reason] += 1
                tally.add(outcome.rejection, outcome.verdict)
            elif outcome.kept is not None:
                kept.append(outcome.kept)
            held += [outcome] if whole else []
    except KeyboardInterrupt:
        if not partial:
            raise
        interrupted = True
    return FilterReport(
        outcomes=tuple(held),
        kept=tuple(kept),
        generated=generated,
        rejected=_commonest_first(reasons),
        seconds=seconds,
        refused=tally.refused(),
        interrupted=interrupted,
    )


def _commonest_first(reasons: Mapping[str, int]) -> dict[str, int]:
    return dict(sorted(reasons.items(), key=lambda item: (-item[1], item[0])))
