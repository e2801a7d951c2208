"""Cases with withheld answers: ``excite.blind/1``, what is hidden; ``excite.blind_answer/1``, what a program says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from excite.results import FEW, Name, Positive, Stated, Unbounded, UnboundedPositive

CaseKind = Literal["single", "weak", "double", "none", "unknown", "everything"]


@dataclass(frozen=True)
class HiddenEffect(Stated):
    """An effect that the nominal model lacks.

    Attributes:
        effect: its name in a diagnosis, or unknown.
        location: its place.
        value: its main parameter, in the unit of that effect.
        form: which form of the same physics; ``plain`` is the textbook's.
        details: further parameters by name.
        detectability: rest that the modelled terms cannot take, over the channel's noise in the band; null where it
            was not computed.
        shares: true shares of the joints' gaps, by joint; empty where they were not computed.
    """

    effect: Name
    location: Name
    value: float
    form: Name = "plain"
    details: Mapping[Name, float] = field(default_factory=dict)
    detectability: Unbounded | None = None
    shares: Annotated[Mapping[Name, float], FEW] = field(default_factory=dict)


@dataclass(frozen=True)
class JointGap(Stated):
    """The true gap of a joint.

    Attributes:
        gap: root mean square of what the modelled terms leave in the band because of the hidden effects [N·m].
        noise: root mean square of the torque's noise in the band [N·m].
        together: share that only several effects at once take; with the shares of all effects, one.
    """

    gap: Positive
    noise: Positive
    together: float


@dataclass(frozen=True)
class Answer(Stated):
    """What a diagnosis of a case should find.

    Attributes:
        kind: kind of the case.
        robot: name of the robot.
        modelled: what the log says is modelled.
        effects: hidden effects, the stronger first; none where there is none.
        noise: factor on the usual noise.
        faults: faults of the record.
        background: what every joint has a little of beside them; empty where the robot has nothing else.
        joints: true gap by joint; empty where it was not computed.
    """

    kind: CaseKind
    robot: Name
    modelled: tuple[Name, ...]
    effects: tuple[HiddenEffect, ...]
    noise: Positive
    faults: tuple[Name, ...] = ()
    background: tuple[HiddenEffect, ...] = ()
    joints: Annotated[Mapping[Name, JointGap], FEW] = field(default_factory=dict)


@dataclass(frozen=True)
class BlindAnswers(Stated):
    """What is hidden in the cases of a folder.

    Attributes:
        cases: by case.
        seed: of the cases.
    """

    SCHEMA = "excite.blind/1"

    cases: Mapping[Name, Answer]
    seed: int | None = None


@dataclass(frozen=True)
class Guess(Stated):
    """An effect and its place.

    Attributes:
        effect: name of the effect, a word of log.yaml's modelled.
        location: joint, link, base or torque.
    """

    effect: Name
    location: Name


@dataclass(frozen=True)
class NamedEffect(Guess):
    """An effect that is there, and what it takes.

    Attributes:
        channel: joint whose gap the share is of; null for the location itself.
        share: of that joint's gap above the noise; null if unknown.
        interval90: 90 % interval of the share; null if unknown.
        tied_locations: places that the log cannot tell from its own.
    """

    channel: Name | None = None
    share: Unbounded | None = None
    interval90: tuple[float, float] | None = None
    tied_locations: tuple[Name, ...] = ()

    @staticmethod
    def contradiction(found: Any) -> str:
        """An interval that is none, or of nothing."""
        if found.interval90 is None:
            return ""
        if found.interval90[0] > found.interval90[1]:
            return f"interval90 ends below its beginning: {found.interval90}"
        return "interval90 is of no share: state the share too" if found.share is None else ""


@dataclass(frozen=True)
class BlindAnswer(Stated):
    """What a program says of one case: effects, the surest first; one of several channels stands once for each.

    Attributes:
        effects: what is there, the surest first; empty where nothing is.
        verdict: null: effect where any is named, else none.
        location: place of a gap without a name.
        rivals: where the verdict is ambiguous, what else the first effect may be.
        program: what wrote this, with its version.
        seconds: processor time it took [s].
    """

    SCHEMA = "excite.blind_answer/1"

    effects: tuple[NamedEffect, ...]
    verdict: Literal["effect", "none", "ambiguous", "unknown"] | None = None
    location: Name | None = None
    rivals: Annotated[tuple[Guess, ...], FEW] = ()
    program: str = ""
    seconds: UnboundedPositive | None = None

    @staticmethod
    def contradiction(found: Any) -> str:
        """A verdict that its effects do not bear out."""
        if found.verdict in {"none", "unknown"} and found.effects:
            return f"verdict is {found.verdict!r} beside effects: leave one of them out"
        if found.verdict in {"effect", "ambiguous"} and not found.effects:
            return f"verdict is {found.verdict!r} without an effect: name one"
        return ""
