"""``excite.simulation/1``: what became of motions on the virtual robot."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from excite.documents.document import (
    MOST_ENTRIES,
    Block,
    Count,
    Document,
    FilePath,
    MaybePositive,
    Name,
    Names,
)


class SimulatedTrial(Block):
    """What became of one motion."""

    trial: Name = Field(description="name of the motion")
    samples: Count = Field(description="number of logged samples")
    fell: bool = Field(description="whether the robot fell")
    self_collided: bool = Field(description="whether it touched itself")
    slip_m: MaybePositive = Field(description="largest slip of a foot [m]")
    tracking_error_rad: MaybePositive = Field(description="largest error of tracking [rad or m]")


class Simulation(Document):
    """What became of motions on the virtual robot."""

    schema_: Literal["excite.simulation/1"] = Field(alias="schema", description="version of this document")
    robot: Name = Field(description="name of the robot")
    log: FilePath = Field(description="description of the log, relative to --out")
    trials: Annotated[list[SimulatedTrial], Field(max_length=MOST_ENTRIES)] = Field(
        description="in the order of the motions"
    )
    fell: bool = Field(description="whether the robot fell in any motion")
    other_version: Names = Field(
        default=[], description="motions that were made for this robot with another description or model"
    )
