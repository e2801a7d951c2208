"""The result of a diagnosis: verdict, gap and effects, as a document, in a sentence and in tables."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Literal, Self

import numpy as np
from scipy.special import ndtri

from excite.arrays import Array
from excite.diagnosis.answer.candidate import (
    Applied,
    Candidate,
    Estimate,
    RobotChanges,
    describe_with_size,
    format_estimate,
    format_percent,
    in_words,
)
from excite.diagnosis.answer.gap import (
    Budget,
    ChannelBudget,
    Curves,
    Detectable,
    Gap,
    RolloutPath,
    TrivialErrors,
    Where,
    describe_closed,
)
from excite.diagnosis.equations.units import unit_at
from excite.display import Row, Tabled, span
from excite.finding import Finding
from excite.results import (
    ADDED,
    FEW,
    HIDDEN,
    LEFT_OUT,
    FilePath,
    Interval,
    Name,
    Seconds,
    Stated,
    Unbounded,
    UnboundedPositive,
    added_as,
    named,
    stated,
    stated_with,
)
from excite.robot.robot import Robot

# What the baseline was fitted to: sizes that were taken from the record before the first effect was asked for.


@dataclass(frozen=True)
class Absorbed(Stated):
    """A size of one joint that was taken from the record before the first effect was asked for.

    Attributes:
        joint: its joint.
        parameter: word of modelled, gain of the servo or torque constant.
        size: value, deviation and unit.
        interval90: 90 % interval [unit]; null where it was not computed.
        given: of a servo's gain, what the log states [unit], by which torques were rebuilt; left out where it does not.
        firmware: the size as the servo's register has it; left out where its table is not known.
        firmware_unit: that register, likewise.
    """

    joint: Name
    parameter: Name
    size: Estimate = field(metadata=HIDDEN)
    interval90: Interval | None = None
    given: Unbounded | None = field(default=None, metadata={**named("stated"), **LEFT_OUT, **ADDED})
    firmware: Unbounded | None = field(default=None, metadata={**LEFT_OUT, **ADDED})
    firmware_unit: Name | None = field(default=None, metadata={**LEFT_OUT, **ADDED})

    @property
    @stated
    def value(self) -> Unbounded:
        """Fitted [unit]."""
        return self.size.value

    @property
    @stated
    def std(self) -> UnboundedPositive | None:
        """Standard deviation [unit]; null where it is not known."""
        return self.size.std

    @property
    @stated
    def unit(self) -> Name:
        """SI unit."""
        return self.size.unit

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """See :meth:`Stated.from_json`."""
        size, between = Estimate.from_json(content), content["interval90"]
        more = (content.get(name) for name in ("stated", "firmware", "firmware_unit"))
        between = None if between is None else tuple(between)
        return cls(content["joint"], content["parameter"], size, between, *more)


def estimated_gains(
    robot: Robot,
    joints: Sequence[str],
    name: str,
    unit: str,
    values: Array,
    estimated: Sequence[bool],
    spread: Array | None = None,
) -> Iterator[Absorbed]:
    """Gains, those of some joints, as the record tells them.

    Args:
        joints: of the values.
        name: of the gain.
        unit: of it at a joint that turns.
        values: ``(n_joints,)`` [unit].
        estimated: which of them are wanted.
        spread: ``(n_joints,)`` standard deviations of the values [unit]; None where they were not computed.
    """
    stds = [None] * len(joints) if spread is None else np.asarray(spread).tolist()
    wide = float(ndtri(0.95))
    for joint, value, guessed, std in zip(joints, np.asarray(values).tolist(), estimated, stds, strict=True):
        if guessed:
            between = None if std is None else (value - wide * std, value + wide * std)
            yield Absorbed(joint, name, Estimate(value, std, unit_at(robot, joint, unit)), between)


def absorbed_lines(items: Sequence[Absorbed]) -> list[str]:
    """A line for each parameter that was fitted, with its value and 90 % interval at every joint."""
    kinds = dict.fromkeys((item.parameter, item.size.unit) for item in items)
    lines = []
    for name, unit in kinds:
        each = [item for item in items if (item.parameter, item.size.unit) == (name, unit)]
        lines.append(f"{name.replace('_', ' ')} [{unit}]: " + ", ".join(_in_words(item) for item in each))
    return ["", "fitted to the record before any effect, with 90 % intervals:", *lines] if lines else []


def _in_words(item: Absorbed) -> str:
    between = ""
    if item.interval90 is not None:
        low, high = (f"{end:.3g}" for end in item.interval90)
        between = f" ({span(low, high, '…')})"
    given = "" if item.given is None else f", stated {item.given:.3g}"
    units = "" if item.firmware is None else f", {item.firmware:.3g} of {item.firmware_unit}"
    return f"{item.joint} {item.size.value:.3g}{between}{given}{units}"


# What a diagnosis says: its verdict, gap and effects, as a document, as a sentence and in words for a
# terminal.

Verdict = Literal["effect", "none", "ambiguous", "unknown"]
# Up to so many times the noise floor a model is said to reach it.
_AT_FLOOR = 1.3


_Errors = Annotated[dict[Name, UnboundedPositive], FEW]


@dataclass(frozen=True)
class Rollout(Stated):
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

    before: _Errors
    after: _Errors
    horizon_s: Seconds
    model: FilePath | None
    driven_by: str = field(default="logged torque", metadata=added_as("the record"))
    warnings: tuple[str, ...] = ()
    floor: _Errors = field(default_factory=dict)
    path: RolloutPath | None = field(default=None, metadata=HIDDEN)

    @staticmethod
    def contradiction(found: Any) -> str:
        """A channel before that is not there after."""
        lacking = next((name for name in found.before if name not in found.after), None)
        return "" if lacking is None else f"after should have the channel {lacking[:60]!r} of before"


@dataclass(frozen=True)
class NextExperiment(Stated):
    """What to measure next.

    Attributes:
        why: one sentence.
        separates: effects (``EFFECT`` or ``EFFECT@LOCATION``) that it tells apart.
        motion: file of the motion, None where no motion helps or none was planned.
    """

    why: str
    separates: tuple[str, ...]
    motion: FilePath | None = None


@dataclass(frozen=True)
class LogFault(Stated):
    """Something that was wrong with the record.

    Attributes:
        kind: a word that programs can test for.
        where: trial, channel or both.
        what: one sentence with the number.
        cause: the likely cause.
        repaired: whether it was repaired for the diagnosis.
    """

    kind: Name
    where: str
    what: str
    cause: str
    repaired: bool


@dataclass(frozen=True)
class Noticed(Finding):
    """What the doctor found in the record."""

    @property
    @stated
    def code(self) -> Name:
        """As kind."""
        return self.kind

    @property
    @stated
    def where(self) -> str:
        """Trials and places."""
        return super().where

    @property
    @stated
    def message(self) -> str:
        """As text."""
        return self.text


@dataclass(frozen=True, repr=False)
class Diagnosis(Tabled, Stated):
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
        applied: the robot that was written with the effects; left out where none was.
        log_file: the log, relative to the document's folder; null where it was made in memory.
        robot_file: the nominal robot where another than the log's was given, likewise.
    """

    SCHEMA = "excite.diagnosis/1"

    robot: Name = field(metadata=ADDED)
    verdict: Verdict
    effect: Name | None
    location: Name | None
    tied_locations: tuple[Name, ...]
    candidates: tuple[Candidate, ...]
    effects: tuple[Candidate, ...] = field(metadata=added_as(()))
    gap: Gap
    where: Annotated[tuple[Where, ...], FEW]
    simulation: Rollout | None = None
    n_tied: int = field(default=0, metadata=HIDDEN)
    next_experiment: NextExperiment | None = None
    faults: tuple[Finding, ...] = field(default=(), metadata=HIDDEN)
    warnings: tuple[str, ...] = ()
    budget: Budget | None = field(default=None, metadata=HIDDEN)
    modelled: tuple[str, ...] = ()
    absorbed: tuple[Absorbed, ...] = field(default=(), metadata=named("baseline"))
    trivial: Annotated[dict[Name, TrivialErrors], FEW] = field(default_factory=dict)
    changes: tuple[RobotChanges, ...] = field(default=(), compare=False, repr=False, metadata=HIDDEN)
    curves: Curves | None = field(default=None, compare=False, repr=False, metadata=HIDDEN)
    applied: Applied | None = field(default=None, metadata=LEFT_OUT)
    log_file: FilePath | None = field(default=None, metadata=LEFT_OUT)
    robot_file: FilePath | None = field(default=None, metadata=LEFT_OUT)

    tables = ("candidates", "effects", "gap", "where", "budget", "findings")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.display.Tabled`.

        Candidates, likeliest first; accepted effects with their sizes beside each other; the gap of each channel
        before and after; where it lies; what takes which share of it; or what the doctor found in the record.
        """
        if table in {"candidates", "effects"}:
            accepted = {(item.effect, item.location) for item in self.effects}
            return [candidate_row(item, accepted) for item in getattr(self, table)]
        if table == "gap":
            return [item.row(channel=name) for name, item in self.gap.per_channel.items()]
        if table == "where":
            return [item.row() for item in self.where]
        if table == "budget":
            return [] if self.budget is None else budget_rows(self.budget)
        return [item.row() for item in self.log]

    @property
    def ambiguous_with(self) -> tuple[Candidate, ...]:
        """Candidates that the data cannot tell apart; empty unless the verdict is ``ambiguous``."""
        return self.candidates[: self.n_tied] if self.verdict == "ambiguous" else ()

    @property
    @stated_with(stated="n_tied", added=0)
    def n_ambiguous(self) -> int:
        """Number of leading candidates that the data cannot tell apart."""
        return len(self.ambiguous_with)

    @property
    @stated_with(added=())
    def log(self) -> tuple[LogFault, ...]:
        """What was wrong with the record."""
        return tuple(
            LogFault(item.kind, item.where, item.text, item.remedy, item.repaired) for item in self.faults
        )

    @property
    @stated_with(added=())
    def findings(self) -> tuple[Noticed, ...]:
        """The same, with their figures."""
        return tuple(
            Noticed(**{one.name: getattr(item, one.name) for one in fields(Finding)}) for item in self.faults
        )

    @property
    @stated_with(stated="budget", added={}, **LEFT_OUT)
    def shares(self) -> Annotated[dict[Name, ChannelBudget], FEW] | None:
        """Where each channel's gap goes; left out where it was not computed."""
        return None if self.budget is None else self.budget.channels

    @property
    @stated_with(added="", **LEFT_OUT)
    def budget_sentence(self) -> str | None:
        """The budget in one sentence."""
        return None if self.budget is None else self.budget.sentence()

    @property
    @stated_with(added=(), **LEFT_OUT)
    def detectable(self) -> tuple[Detectable, ...] | None:
        """How large effects would have to be for the record to show them."""
        return None if self.budget is None else self.budget.detectable

    @stated_with(added="")
    def sentence(self) -> str:
        """What was found, in the one sentence that a person would repeat to a colleague."""
        gap = f"{format_percent(self.gap.before)} of the signal"
        of = "gap of the positions" if self.gap.of_positions else "gap"
        closes = f"closes {100 * self.gap.share_closed:.0f} % of the {of} above the noise"
        # A body that is heavier than in the file has been taken up then, and is no gap.
        fitted = ", its bodies fitted to the record," if "rigid_body" in self.modelled else ""
        if self.verdict == "none" and self.gap.before <= _AT_FLOOR * self.gap.noise_floor:
            return f"{self.robot}: the model{fitted} explains the record to its noise floor ({gap})."
        if self.verdict == "none":
            floor = format_percent(self.gap.noise_floor)
            return f"{self.robot}: the model{fitted} leaves {gap}, the noise {floor}; no effect stands out in between."
        if self.verdict == "unknown":
            place = self.location or (self.where[0].channel if self.where else "the robot")
            left = describe_unnamed_gap(place, self.where, self.warnings)
            if self.effects:
                one = len(self.effects) == 1
                clear = join_words([describe_with_size(item) for item in self.effects])
                clear += f" {'is clear at its' if one else 'are clear at their'} own place, and adding "
                clear += f"{'it' if one else 'them'} {closes}"
                return f"{self.robot}: {clear}; {left} ({gap} before)."
            return f"{self.robot}: {left} ({gap})."
        if self.verdict == "ambiguous":
            either, of_all = describe_rivals(self.effects, self.ambiguous_with)
            tells = "which of these; adding all" if of_all else "which; adding one"
            return f"{self.robot}: the gap is {either}; this record cannot say {tells} {closes}."
        each = [describe_with_size(item) for item in self.effects] or [in_words(self.effect, self.location)]
        named = join_words(each)
        them = "it" if len(self.effects) < 2 else "both" if len(self.effects) == 2 else "them"
        return f"{self.robot}: the gap is {named}; adding {them} {closes}."

    def summary(self) -> str:
        """The diagnosis in words and tables, for a terminal; starts with the sentence."""
        lines = [self.sentence(), ""]
        if len(self.tied_locations) > 1:
            lines += [f"places that cannot be told apart: {', '.join(self.tied_locations)}", ""]
        lines += [*gap_table(self.gap, self.where), *baseline_lines(self.modelled)]
        listed = effect_table(self.effects, self.candidates, self.ambiguous_with)
        lines += ["", *listed, *([f"({describe_closed(self.gap.of_positions)})"] if listed else [])]
        if self.budget is not None:
            lines += ["", *budget_lines(self.budget, self.gap, self.modelled, accepted=bool(self.effects))]
        lines += absorbed_lines(self.absorbed)
        lines += trivial_table(self.trivial)
        if self.next_experiment is not None:
            lines += ["", f"next: {self.next_experiment.why}"]
        lines += [f"log: {i.text} ({i.remedy}{'; repaired' if i.repaired else ''})" for i in self.faults]
        said = {item.text for item in self.faults}
        lines += [f"note: {text}" for text in self.warnings if text not in said and text not in lines[0]]
        return "\n".join(lines)


# The tables of a diagnosis in words, for a terminal: the gap by channel, and effects with their rivals.

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
    beside = explain_named_share(named, gap.share_closed, accepted=accepted)
    said = [text for text in (beside, explain_other_joint(gaps, budget.channel_weights, modelled)) if text]
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
            between = (
                f"{span(_format_percentage(low), _format_percentage(high), '…')}%"
                if math.isfinite(low + high)
                else ""
            )
            what = in_words(item.effect, item.location)
            doubt = explain_share(item.share, *item.interval90)
            mark = f" {notes.setdefault(doubt, f'[{len(notes) + 1}]')}" if doubt else ""
            lines.append(f"{name:{width}}  {_format_percentage(item.share):>4}%  {between:>10}  {what}{mark}")
        for other in channel.unnamed:
            what = other.follows if not other.knots else f"follows {other.follows}, without a name"
            lines.append(f"{name:{width}}  {_format_percentage(other.share):>4}%  {'':10}  {what}")
        lines.append(f"{name:{width}}  {_format_percentage(channel.rest):>4}%  {'':10}  the rest")
    held = [f"({HELD})"] if any(channel.effects for channel in budget.channels.values()) else []
    return [*lines, *(f"{mark} {doubt}" for doubt, mark in notes.items()), *held]


def _format_percentage(share: float) -> str:
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
    rows = {name: [getattr(item, n) for n in names] for name, item in errors.items()}
    if all(value is None for row in rows.values() for value in row[1:]):
        return []
    width = max([len(name) for name in errors] + [7])
    heads = ("model", "command", "delayed", "filter", "repeat")
    lines = ["", f"{'channel':{width}}  " + "  ".join(f"{h:>8}" for h in heads) + "  RMSE on what judges"]
    for name, row in rows.items():
        values = "  ".join(f"{'' if v is None else format(v, '.3g'):>8}" for v in row)
        lines.append(f"{name:{width}}  {values}  [{errors[name].unit}]")
    return lines


def join_words(each: Sequence[str]) -> str:
    """Words with commas between them and ``and`` before the last."""
    return " and ".join([", ".join(each[:-1]), each[-1]] if len(each) > 1 else each)


def describe_unnamed_gap(place: str, where: Sequence[Where], warnings: Sequence[str]) -> str:
    """An unknown gap in words: what it is like, where that is known, or what it follows."""
    like = next((text for text in warnings if text.endswith(NO_NAME)), None)
    follows = "".join(
        f" follows {item.depends_on} and that"
        for item in where
        if item.channel == place and item.dependence.get(item.depends_on, 0.0) >= _FOLLOWS
    )
    return like or f"there is a gap at {place} that{follows} no effect in the library explains"


def describe_rivals(effects: Sequence[Candidate], ambiguous_with: Sequence[Candidate]) -> tuple[str, bool]:
    """Effects that cannot be told apart, in words, behind accepted ones that are sure; and whether there are such."""
    open_ = {(item.effect, item.location) for item in ambiguous_with}
    sure = [describe_with_size(item) for item in effects if (item.effect, item.location) not in open_]
    either = " or ".join(describe_with_size(item) for item in ambiguous_with)
    return (f"{join_words(sure)}, and {either}", True) if sure else (either, False)


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
        lines.append(_format_candidate_line(item, standing))
    return lines


def _format_candidate_line(item: Candidate, standing: str) -> str:
    values = ", ".join(f"{name} {format_estimate(e)}" for name, e in item.parameters.items())
    return (
        f"{item.effect:24} {item.location or '':24} {standing:9} {item.evidence:9.1f} "
        f"{100 * item.share_closed:6.0f}%  {values}"
    )


# What a budget's figures leave open, in words: intervals that say little, and a gap that lies elsewhere.

# What is said wherever intervals of shares are shown.
HELD = (
    "90 % intervals of shares, by blocks left out, held 91 % of the truth of effects planted in records of eight "
    "machines, and 80 % on ten simulated arms with many effects"
)
# Wider intervals are worth a word.
_WIDE = 0.5


# Shares that differ by more than this are explained.
_DIFFERS = 0.1


def explain_share(share: float | None, low: float | None, high: float | None) -> str:
    """Why a share and its interval do not seem to fit each other, or say little; empty where they do not.

    Args:
        share: of a channel's gap above its noise, 0…1; None where it was not computed.
        low: lower end of its 90 % interval; None where it was not computed.
        high: upper end, alike.

    A number that is not finite counts as not computed.
    """
    if share is None or low is None or high is None or not math.isfinite(share + low + high):
        return ""
    if share < 0.0:
        return "does harm on the trials that judge"
    if low <= 0.0 < share:
        return "may be nothing: too few stretches of the record show it for more"
    if high - low > _WIDE:
        return "known roughly: few stretches of the record show it"
    if not low <= share <= high:
        return "the trials that judge show it otherwise than the rest of the record"
    return ""


def explain_other_joint(
    gaps: Mapping[str, tuple[float, float]], weights: Mapping[str, float], modelled: Sequence[str]
) -> str:
    """Why the budget finds the gap at another joint than the gaps by channel do; empty where both find it at one.

    Each fits the bodies anew, and the motion of one body makes torques at several joints: what no bodies explain, such
    as a gain of the torques of one joint, a fit may leave at that joint or at the one before it.

    Args:
        gaps: by channel, the gap without effects and its noise floor, both in the channel's unit.
        weights: by channel, its share of the whole gap in the budget.
        modelled: what the model had before the first effect; of bodies that were not fitted nothing is said.
    """
    excess = {name: before / max(floor, 1e-300) for name, (before, floor) in gaps.items()}
    here, there = (max(table, key=lambda name: table[name], default="") for table in (weights, excess))
    if "rigid_body" not in modelled or not here or here == there:
        return ""
    if weights[here] <= 0.0 or excess.get(here, 0.0) >= excess[there]:
        return ""
    return (
        f"the budget counts the gap where most of it lies at {here}, before and after count it where most lies at "
        f"{there}: bodies are fitted anew in both, and what they do not explain may be left at one joint or at another"
    )


def explain_named_share(named: float, closed: float | None, *, accepted: bool) -> str:
    """Why the parts with a name are not what the accepted effects close; empty where both say nearly the same.

    Args:
        named: share of the whole gap that the budget gives to effects.
        closed: share of it that the accepted effects close; None where it was not computed.
        accepted: whether any was.
    """
    if closed is None or abs(named - closed) <= _DIFFERS:
        return ""
    taken = f"the accepted effects close {100.0 * closed:.0f} %" if accepted else "no effect was accepted"
    return (
        f"here named effects take {100.0 * named:.0f} %, and {taken}: both are right; the first counts all that "
        "one fit of everything together finds, the motion alone and each joint by its own power; the second what the "
        "effects that stand clear leave of all rows, each joint by its own signal"
    )
