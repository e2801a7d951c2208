"""What explains how much of a diagnosis's gap: a part of ``excite.diagnosis/1``."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from excite.documents.document import (
    MOST_ENTRIES,
    Block,
    Interval,
    Maybe,
    MaybePositive,
    Name,
)


class EffectShare(Block):
    """What a named effect takes of a channel's gap."""

    effect: Name = Field(description="name of the effect")
    location: Name = Field(description="its place")
    share: Maybe = Field(description="of the channel's power above the noise floor, on trials that judge")
    interval90: Interval = Field(description="90 % interval of the share, by blocks left out")


class UnnamedShare(Block):
    """What a function of one thing takes of a channel's gap, which no effect's name stands for."""

    follows: Name = Field(
        description="position, velocity, load, acceleration, time, another joint, does not repeat"
    )
    share: Maybe = Field(description="of the channel's power above the noise floor, on trials that judge")
    knots: Annotated[list[Maybe], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="of the piecewise linear function; none where it is no function of one thing"
    )
    torque: Annotated[list[Maybe], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="its values there [the channel's unit]"
    )


class ChannelBudget(Block):
    """A channel's gap and where it goes; shares of effects, unnamed ones and the rest add up to one."""

    noise_floor: MaybePositive = Field(description="what no model can go below [unit]")
    gap: MaybePositive = Field(description="without any effect, standstill left out [unit]")
    unit: Name = Field(default="", description="unit of the two")
    weight: Maybe = Field(default=0.0, description="of the channel's gap among all channels")
    effects: Annotated[list[EffectShare], Field(max_length=MOST_ENTRIES)] = Field(
        description="what named effects take"
    )
    unnamed: Annotated[list[UnnamedShare], Field(max_length=MOST_ENTRIES)] = Field(
        description="what follows something and has no name"
    )
    rest: Maybe = Field(description="share that is left")


class Detectable(Block):
    """How large an effect would have to be for this record to show it."""

    effect: Name = Field(description="name of the effect")
    location: Name = Field(description="its place")
    size: MaybePositive = Field(description="smallest size that would be named [unit]; null where none would")
    unit: Name = Field(description="SI unit; 1 where it has none")
