"""``excite.blind/1``: what is hidden in cases whose answers are withheld."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from excite.documents.document import (
    MOST_CHANNELS,
    MOST_ENTRIES,
    Block,
    Document,
    Maybe,
    MaybePositive,
    Name,
    Names,
    Number,
    Positive,
    Text,
)


class HiddenEffect(Block):
    """An effect that the nominal model lacks."""

    effect: Name = Field(description="its name in a diagnosis, or unknown")
    location: Name = Field(description="its place")
    value: Number = Field(description="its main parameter, in the unit of that effect")
    form: Name = Field(default="plain", description="which form of the same physics")
    details: Annotated[dict[Name, Number], Field(max_length=MOST_ENTRIES)] = Field(
        default={}, description="further parameters by name"
    )
    detectability: Maybe = Field(
        default=None, description="how far it stands above the noise; null where it was not computed"
    )
    shares: Annotated[dict[Name, Number], Field(max_length=MOST_CHANNELS)] = Field(
        default={},
        description="true shares of the joints' gaps, by joint; empty where they were not computed",
    )


class JointGap(Block):
    """The true gap of a joint."""

    gap: Positive = Field(description="root mean square that hidden effects leave in the band [N·m]")
    noise: Positive = Field(description="root mean square of the noise in the band [N·m]")
    together: Number = Field(description="share that only several effects at once take")


class Answer(Block):
    """What a diagnosis of a case should find."""

    kind: Literal["single", "weak", "double", "none", "unknown", "everything"] = Field(
        description="kind of the case"
    )
    robot: Name = Field(description="name of the robot")
    modelled: Names = Field(description="what the log says is modelled")
    effects: Annotated[list[HiddenEffect], Field(max_length=MOST_ENTRIES)] = Field(
        description="hidden effects, the stronger first"
    )
    noise: Positive = Field(description="factor on the usual noise")
    faults: Names = Field(default=[], description="faults of the record")
    background: Annotated[list[HiddenEffect], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="what every joint has a little of"
    )
    joints: Annotated[dict[Name, JointGap], Field(max_length=MOST_CHANNELS)] = Field(
        default={}, description="true gap by joint; empty where it was not computed"
    )


class BlindAnswers(Document):
    """What is hidden in the cases of a folder."""

    schema_: Literal["excite.blind/1"] = Field(alias="schema", description="version of this document")
    seed: int | None = Field(default=None, description="of the cases")
    cases: Annotated[dict[Name, Answer], Field(max_length=MOST_ENTRIES)] = Field(description="by case")


# ``excite.blind_answer/1``: what any program says of a blind case.


class Guess(Block):
    """An effect and its place."""

    effect: Name = Field(description="name of the effect, a word of log.yaml's modelled")
    location: Name = Field(description="joint, link, base or torque")


class NamedEffect(Guess):
    """An effect that is there, and what it takes."""

    channel: Name | None = Field(
        default=None, description="joint whose gap the share is of; null for the location itself"
    )
    share: Maybe = Field(default=None, description="of that joint's gap above the noise; null if unknown")
    interval90: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="90 % interval of the share; null if unknown"
    )
    tied_locations: Names = Field(default=[], description="places that the log cannot tell from its own")

    @model_validator(mode="after")
    def _in_order(self) -> NamedEffect:
        if self.interval90 is not None and self.interval90[0] > self.interval90[1]:
            raise ValueError(f"interval90 ends below its beginning: {self.interval90}")
        if self.interval90 is not None and self.share is None:
            raise ValueError("interval90 is of no share: state the share too")
        return self


class BlindAnswer(Document):
    """What a program says of one case: effects, the surest first; one of several channels stands once for each."""

    schema_: Literal["excite.blind_answer/1"] = Field(alias="schema", description="version of this document")
    effects: Annotated[list[NamedEffect], Field(max_length=MOST_ENTRIES)] = Field(
        description="what is there, the surest first; empty where nothing is"
    )
    verdict: Literal["effect", "none", "ambiguous", "unknown"] | None = Field(
        default=None, description="null: effect where any is named, else none"
    )
    location: Name | None = Field(default=None, description="place of a gap without a name")
    rivals: Annotated[list[Guess], Field(max_length=MOST_CHANNELS)] = Field(
        default=[], description="where the verdict is ambiguous, what else the first effect may be"
    )
    program: Text = Field(default="", description="what wrote this, with its version")
    seconds: MaybePositive = Field(default=None, description="processor time it took [s]")

    @model_validator(mode="after")
    def _agrees(self) -> BlindAnswer:
        if self.verdict in {"none", "unknown"} and self.effects:
            raise ValueError(f"verdict is {self.verdict!r} beside effects: leave one of them out")
        if self.verdict in {"effect", "ambiguous"} and not self.effects:
            raise ValueError(f"verdict is {self.verdict!r} without an effect: name one")
        return self
