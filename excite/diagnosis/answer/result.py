"""What a diagnosis says: its verdict, gap and effects, as a document, as a sentence and in words for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from excite.diagnosis.answer.absorbed import Absorbed, absorbed_lines
from excite.diagnosis.answer.budget import Budget
from excite.diagnosis.answer.candidate import Candidate, in_words, percent, sized
from excite.diagnosis.answer.curves import Curves
from excite.diagnosis.answer.gap import Gap, Where, closed_in_words
from excite.diagnosis.answer.robot_changes import RobotChanges
from excite.diagnosis.answer.rollout_path import RolloutPath
from excite.diagnosis.answer.tables import (
    baseline_lines,
    budget_lines,
    budget_rows,
    candidate_row,
    effect_table,
    either_of,
    fault_entry,
    fault_lines,
    gap_table,
    in_a_row,
    trivial_table,
    without_a_name,
)
from excite.diagnosis.answer.trivial import TrivialErrors
from excite.finding import Finding
from excite.json_document import finite
from excite.shown import Row, Tabled

SCHEMA = "excite.diagnosis/1"
Verdict = Literal["effect", "none", "ambiguous", "unknown"]
# Up to so many times the noise floor a model is said to reach it.
_AT_FLOOR = 1.3


@dataclass(frozen=True)
class Rollout:
    """Short roll-outs of the nominal and of the augmented simulator against the record.

    Attributes:
        before: by channel, RMS error of the nominal simulator [rad or m].
        after: by channel, RMS error of the augmented simulator, same unit.
        horizon_s: length of a roll-out [s].
        model: file name of the augmented simulator, None where none was written.
        driven_by: what drives the roll-outs, in words: the logged torque (no feedback), the same less the noise that
            commands can tell, ``q_cmd`` (the servo), or the ground's wrenches, with a free base.
        warnings: effects that the simulator cannot express or ignores.
        floor: by channel, RMS by which replicas of the nominal simulator differ that start, and are driven, with
            as much noise as the record has; what no model can go below, same unit.
        path: of a trial, for a picture; no part of the document. None where there is none.
    """

    before: dict[str, float]
    after: dict[str, float]
    horizon_s: float
    model: str | None
    driven_by: str = "logged torque"
    warnings: tuple[str, ...] = ()
    floor: dict[str, float] = field(default_factory=dict)
    path: RolloutPath | None = None

    def to_json(self) -> dict[str, Any]:
        """The comparison as it stands in the document."""
        return {
            "before": dict(self.before),
            "after": dict(self.after),
            "floor": dict(self.floor),
            "horizon_s": self.horizon_s,
            "model": self.model,
            "driven_by": self.driven_by,
            "warnings": list(self.warnings),
        }


@dataclass(frozen=True)
class NextExperiment:
    """What to measure next.

    Attributes:
        why: one sentence.
        separates: effects (``EFFECT`` or ``EFFECT@LOCATION``) that it tells apart.
        motion: file of the motion, None where no motion helps or none was planned.
    """

    why: str
    separates: tuple[str, ...]
    motion: str | None = None

    def to_json(self) -> dict[str, Any]:
        """The proposal as it stands in the document."""
        return {"why": self.why, "separates": list(self.separates), "motion": self.motion}


@dataclass(frozen=True, repr=False)
class Diagnosis(Tabled):
    """Where the gap lies, which effect causes it, how far it shrinks.

    Attributes:
        robot: name of the robot.
        verdict: ``effect``, ``none``, ``ambiguous`` or ``unknown``.
        effect: the accepted effect, the likeliest one where the verdict is ambiguous, else None: beside an unknown gap
            those that are clear at their own places all the same are ``effects``.
        location: its likeliest place, or the place of an unknown gap.
        tied_locations: places that the data cannot tell from ``location``, itself among them.
        candidates: likeliest first; where ambiguous, first those that the data cannot tell apart.
        effects: accepted effects in the order in which they were added.
        gap: the gap before and after them.
        where: map of the gap, largest share first.
        simulation: roll-outs, None where there were none.
        n_tied: number of leading candidates that the data cannot tell apart (ambiguous only).
        next_experiment: what would settle what is open, None where nothing is.
        faults: what the doctor found in the record, worst first.
        warnings: limits of what was said, one sentence each.
        budget: where each channel's gap goes; None where it was not computed.
        modelled: what the model had before the first effect, as in ``log.yaml``.
        absorbed: sizes that were fitted to the record before the first effect, joint by joint.
        trivial: by channel, what predictors far simpler than a simulator reach where it is judged.
        changes: what the first none, one, two … of the accepted effects change of the robot; no part of the document.
        curves: a validation trial before and after, for figures; no part of the document. None where there are none.
    """

    robot: str
    verdict: Verdict
    effect: str | None
    location: str | None
    tied_locations: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    effects: tuple[Candidate, ...]
    gap: Gap
    where: tuple[Where, ...]
    simulation: Rollout | None = None
    n_tied: int = 0
    next_experiment: NextExperiment | None = None
    faults: tuple[Finding, ...] = ()
    warnings: tuple[str, ...] = ()
    budget: Budget | None = None
    modelled: tuple[str, ...] = ()
    absorbed: tuple[Absorbed, ...] = ()
    trivial: dict[str, TrivialErrors] = field(default_factory=dict)
    changes: tuple[RobotChanges, ...] = field(default=(), compare=False, repr=False)
    curves: Curves | None = field(default=None, compare=False, repr=False)

    tables = ("candidates", "effects", "gap", "where", "budget", "findings")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.shown.Tabled`.

        Candidates, likeliest first; accepted effects with their sizes beside each other; the gap of each channel
        before and after; where it lies; what takes which share of it; or what the doctor found in the record.
        """
        if table in {"candidates", "effects"}:
            accepted = {(item.effect, item.location) for item in self.effects}
            return [candidate_row(item, accepted) for item in getattr(self, table)]
        if table == "gap":
            return [{"channel": name, **asdict(item)} for name, item in self.gap.per_channel.items()]
        if table == "where":
            return [item.to_json() for item in self.where]
        if table == "budget":
            return [] if self.budget is None else budget_rows(self.budget)
        return [fault_entry(item) for item in self.faults]

    @property
    def ambiguous_with(self) -> tuple[Candidate, ...]:
        """Candidates that the data cannot tell apart; empty unless the verdict is ``ambiguous``."""
        return self.candidates[: self.n_tied] if self.verdict == "ambiguous" else ()

    def to_json(self) -> dict[str, Any]:
        """The document ``excite.diagnosis/1``; what is infinite or not known is null."""
        return finite(
            {
                "schema": SCHEMA,
                "robot": self.robot,
                "verdict": self.verdict,
                "effect": self.effect,
                "location": self.location,
                "tied_locations": list(self.tied_locations),
                "candidates": [item.to_json() for item in self.candidates],
                "n_tied": len(self.ambiguous_with),
                "effects": [item.to_json() for item in self.effects],
                "gap": self.gap.to_json(),
                "simulation": None if self.simulation is None else self.simulation.to_json(),
                "where": [item.to_json() for item in self.where],
                "next_experiment": None if self.next_experiment is None else self.next_experiment.to_json(),
                "sentence": self.sentence(),
                "log": [fault_entry(item) for item in self.faults],
                "findings": [
                    {"code": item.kind, "where": item.where, "message": item.text, **item.to_json()}
                    for item in self.faults
                ],
                "warnings": list(self.warnings),
                "modelled": list(self.modelled),
                "baseline": [item.to_json() for item in self.absorbed],
                "trivial": {name: item.to_json() for name, item in self.trivial.items()},
                **({} if self.budget is None else self.budget.to_json()),
            }
        )

    def sentence(self) -> str:
        """The one sentence that a person would repeat to a colleague."""
        gap = f"{percent(self.gap.before)} of the signal"
        of = "gap of the positions" if self.gap.of_positions else "gap"
        closes = f"closes {100 * self.gap.share_closed:.0f} % of the {of} above the noise"
        # A body that is heavier than in the file has been taken up then, and is no gap.
        fitted = ", its bodies fitted to the record," if "rigid_body" in self.modelled else ""
        if self.verdict == "none" and self.gap.before <= _AT_FLOOR * self.gap.noise_floor:
            return f"{self.robot}: the model{fitted} explains the record to its noise floor ({gap})."
        if self.verdict == "none":
            floor = percent(self.gap.noise_floor)
            return f"{self.robot}: the model{fitted} leaves {gap}, the noise {floor}; no effect stands out in between."
        if self.verdict == "unknown":
            place = self.location or (self.where[0].channel if self.where else "the robot")
            left = without_a_name(place, self.where, self.warnings)
            if self.effects:
                one = len(self.effects) == 1
                clear = (
                    f"{in_a_row([sized(item) for item in self.effects])} {'is' if one else 'are'} clear at "
                )
                clear += (
                    f"{'its' if one else 'their'} own place, and adding {'it' if one else 'them'} {closes}"
                )
                return f"{self.robot}: {clear}; {left} ({gap} before)."
            return f"{self.robot}: {left} ({gap})."
        if self.verdict == "ambiguous":
            either, of_all = either_of(self.effects, self.ambiguous_with)
            tells = "which of these; adding all" if of_all else "which; adding one"
            return f"{self.robot}: the gap is {either}; this record cannot say {tells} {closes}."
        each = [sized(item) for item in self.effects] or [in_words(self.effect, self.location)]
        named = in_a_row(each)
        them = "it" if len(self.effects) < 2 else "both" if len(self.effects) == 2 else "them"
        return f"{self.robot}: the gap is {named}; adding {them} {closes}."

    def summary(self) -> str:
        """The diagnosis in words and tables, for a terminal; starts with the sentence."""
        lines = [self.sentence(), ""]
        if len(self.tied_locations) > 1:
            lines += [f"places that cannot be told apart: {', '.join(self.tied_locations)}", ""]
        lines += [*gap_table(self.gap, self.where), *baseline_lines(self.modelled)]
        listed = effect_table(self.effects, self.candidates, self.ambiguous_with)
        lines += ["", *listed, *([f"({closed_in_words(self.gap.of_positions)})"] if listed else [])]
        if self.budget is not None:
            lines += ["", *budget_lines(self.budget, self.gap, self.modelled, accepted=bool(self.effects))]
        lines += absorbed_lines(self.absorbed)
        lines += trivial_table(self.trivial)
        if self.next_experiment is not None:
            lines += ["", f"next: {self.next_experiment.why}"]
        lines += fault_lines(self.faults)
        said = {item.text for item in self.faults}
        lines += [f"note: {text}" for text in self.warnings if text not in said and text not in lines[0]]
        return "\n".join(lines)
