"""``excite.blind/1``: what is hidden in cases whose answers are withheld."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from excite.documents.document import (
    MOST_CHANNELS,
    MOST_ENTRIES,
    Block,
    Document,
    Maybe,
    Name,
    Names,
    Number,
    Positive,
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
