"""``excite.human/1``: a person as measured, and what identification found of the segments."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from excite.documents.document import (
    MOST_CHANNELS,
    MOST_ENTRIES,
    Block,
    Document,
    FilePath,
    Maybe,
    MaybePositive,
    Name,
    Names,
    Positive,
)
from excite.documents.finding import Finding


class TableMass(Block):
    """A segment's mass by two tables."""

    segment: Name = Field(description="name of the segment")
    de_leva_kg: Positive = Field(description="de Leva 1996 [kg]")
    dumas_kg: Positive = Field(description="Dumas 2007 [kg]")


class ReactionFit(Block):
    """A component of the ground reaction, measured and predicted."""

    unit: Name = Field(description="N or N·m")
    rmse: MaybePositive = Field(description="root mean square error of the identified model")
    cc: Maybe = Field(default=None, description="correlation of measured and predicted")
    reference_rmse: MaybePositive = Field(description="error of the nominal model")
    reference_cc: Maybe = Field(default=None, description="correlation of the nominal model's")


Reaction = Annotated[dict[Name, ReactionFit], Field(max_length=MOST_CHANNELS)]


class MeasuredSubject(Block):
    """Who was measured."""

    mass: Positive = Field(description="with all that is worn [kg]")


class MeasuredTrial(Block):
    """A trial of a person."""

    trial: Name = Field(description="its name")
    plates_kg: Maybe = Field(
        default=None, description="mass that the plates say [kg]; null where they do not tell"
    )


class Human(Document):
    """What ``excite human`` found of a person."""

    schema_: Literal["excite.human/1"] = Field(alias="schema", description="version of this document")
    files: Names = Field(
        default=[],
        description="names of all files that were written, which the next run into the folder replaces",
    )
    robot_file: FilePath | None = Field(
        default=None, description="robot.yaml of the person, relative to this file"
    )
    log_file: FilePath | None = Field(
        default=None, description="log folder of the trials, relative to this file"
    )
    subject: MeasuredSubject | None = Field(default=None, description="the person")
    marker_rms_m: MaybePositive = Field(
        default=None, description="distance of the markers from the calibrated body, RMS [m]"
    )
    trials: Annotated[list[MeasuredTrial], Field(max_length=MOST_CHANNELS)] = Field(
        default=[], description="in order"
    )
    findings: Annotated[list[Finding], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="what was wrong with the recordings"
    )
    table: Name = Field(description="table of the nominal masses")
    segments: Annotated[list[TableMass], Field(max_length=MOST_CHANNELS)] = Field(
        description="masses by the tables"
    )
    ground_reaction: dict[Literal["identification", "validation"], Reaction] | None = Field(
        default=None, description="by role of the trials and component, world axes"
    )
