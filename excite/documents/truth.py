"""``excite.truth/1``: what a virtual robot truly weighs."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from excite.documents.document import MOST_CHANNELS, MOST_ENTRIES, Block, Document, Name, Number


class Added(Block):
    """A body that the model does not have."""

    what: Name = Field(description="what it is")
    link: Name = Field(description="link that carries it")
    mass: Number = Field(description="[kg]")


class InjectedEffect(Block):
    """An effect that the nominal model lacks."""

    effect: Name = Field(description="name of the effect")
    location: Name = Field(description="where it sits")
    value: Number = Field(description="how much, in its unit")
    unit: str = Field(description="unit of the value", max_length=40)


class Truth(Document):
    """True inertial parameters of a virtual robot, for comparison afterwards."""

    schema_: Literal["excite.truth/1"] = Field(alias="schema", description="version of this document")
    robot: Name = Field(description="name of the robot")
    masses: Annotated[dict[Name, Number], Field(max_length=MOST_CHANNELS)] = Field(
        description="true mass by link [kg]"
    )
    added: Annotated[list[Added], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="bodies that were added"
    )
    parameters: Annotated[list[Number], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="ten inertial parameters a link, about its joint's frame [SI]"
    )
    injected: Annotated[list[InjectedEffect], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="effects that were injected, which the log's `modelled` does not name"
    )
