"""What became of candidates: each, and all of them counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.safety.refusals import RefusalTally, Refused, joined_refusals
from excite.safety.repairs.draft import Rejection
from excite.safety.verdict import Verdict

_Number = TypeVar("_Number", int, float)


@dataclass(frozen=True, eq=False)
class FilterOutcome:
    """What became of one candidate.

    Attributes:
        candidate: its name.
        generator: its generator.
        motion: the motion, None if rejected or handed to ``keep``.
        verdict: the independent verdict, None if no motion came out of the repairs.
        rejection: why it was rejected, None if accepted.
        seconds: processor time by stage [s]; stages are ``draw`` of a proposal, the repairs and ``check``.
        kept: what ``keep`` made of an accepted motion.
    """

    candidate: str
    generator: str
    motion: Motion | None
    verdict: Verdict | None
    rejection: Rejection | None
    seconds: Mapping[str, float]
    kept: Any = None

    @property
    def accepted(self) -> bool:
        """Whether the motion may be run."""
        return self.rejection is None


@dataclass(frozen=True, eq=False)
class FilterReport:
    """What became of all candidates, in their order.

    Attributes:
        outcomes: one per candidate; none where accepted motions were handed to ``keep``, so that memory does not grow
            with the number of candidates.
        kept: what ``keep`` made of the accepted motions.
        rejected: number of rejected candidates by reason, the commonest first.
        made: number of candidates by generator.
        accepted: number of accepted ones by generator.
        stage_seconds: processor time by stage, over all candidates and processes [s].
        refused: what refuses them, by pair of links, joint, contact or limit, the commonest first.
        interrupted: whether somebody broke off before all candidates were judged.
    """

    outcomes: tuple[FilterOutcome, ...]
    kept: tuple[Any, ...]
    rejected: dict[str, int]
    made: dict[str, int]
    accepted: dict[str, int]
    stage_seconds: dict[str, float]
    refused: tuple[Refused, ...] = ()
    interrupted: bool = False

    @property
    def generated(self) -> int:
        """Number of candidates."""
        return sum(self.made.values())

    @property
    def motions(self) -> tuple[Motion, ...]:
        """The accepted motions, but for those handed to ``keep``."""
        return tuple(o.motion for o in self.outcomes if o.accepted and o.motion is not None)

    def joined(self, more: FilterReport) -> FilterReport:
        """The report of these candidates and of ``more`` after them."""
        return FilterReport(
            outcomes=(*self.outcomes, *more.outcomes),
            kept=(*self.kept, *more.kept),
            rejected=_commonest_first(_add_counts(self.rejected, more.rejected)),
            made=_add_counts(self.made, more.made),
            accepted=_add_counts(self.accepted, more.accepted),
            stage_seconds=_add_counts(self.stage_seconds, more.stage_seconds),
            refused=joined_refusals(self.refused, more.refused),
            interrupted=self.interrupted or more.interrupted,
        )

    def summary(self) -> str:
        """One line for a person."""
        reasons = ", ".join(f"{count} {reason}" for reason, count in self.rejected.items())
        accepted = self.generated - sum(self.rejected.values())
        return f"{accepted} of {self.generated} candidates accepted" + (
            f"; rejected: {reasons}" if reasons else ""
        )


def count_outcomes(
    robot: Robot, outcomes: Iterable[FilterOutcome], *, whole: bool, partial: bool = False
) -> FilterReport:
    """Count outcomes as they come; they are held where the report is to be ``whole``.

    Where a ``partial`` report will do, a user's interrupt ends it with what had been counted by then.
    """
    held: list[FilterOutcome] = []
    kept: list[Any] = []
    made, accepted, reasons = Counter[str](), Counter[str](), Counter[str]()
    seconds: dict[str, float] = {}
    tally = RefusalTally(robot)
    interrupted = False
    try:
        for outcome in outcomes:
            made[outcome.generator] += 1
            accepted[outcome.generator] += outcome.accepted
            if outcome.rejection is not None:
                reasons[outcome.rejection.reason] += 1
                tally.add(outcome.rejection, outcome.verdict)
            elif outcome.kept is not None:
                kept.append(outcome.kept)
            for stage, spent in outcome.seconds.items():
                seconds[stage] = seconds.get(stage, 0.0) + spent
            held += [outcome] if whole else []
    except KeyboardInterrupt:
        if not partial:
            raise
        interrupted = True
    return FilterReport(
        outcomes=tuple(held),
        kept=tuple(kept),
        rejected=_commonest_first(reasons),
        made=dict(made),
        accepted=dict(accepted),
        stage_seconds=seconds,
        refused=tally.refused(),
        interrupted=interrupted,
    )


def _commonest_first(reasons: Mapping[str, int]) -> dict[str, int]:
    return dict(sorted(reasons.items(), key=lambda item: (-item[1], item[0])))


def _add_counts(one: Mapping[str, _Number], other: Mapping[str, _Number]) -> dict[str, _Number]:
    """Numbers by name, added up; names in the order in which they come."""
    added = dict(one)
    for name, number in other.items():
        added[name] = added[name] + number if name in added else number
    return added
