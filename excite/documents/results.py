"""Documents of results other than plans, identifications and diagnoses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field, model_validator

from excite.documents.document import (
    AS_DOCUMENT,
    MOST_CHANNELS,
    MOST_ENTRIES,
    NONE,
    Block,
    Count,
    Document,
    FilePath,
    Findings,
    Maybe,
    MaybePositive,
    Name,
    Names,
    Number,
    Positive,
    Text,
    Texts,
)
from excite.identification.judgement.judgement import ChannelFit

# ``excite.doctor/1``: what is wrong with a log, worst first.


class Doctor(Document):
    """What was found in a log, and where the repaired one is."""

    schema_: Literal["excite.doctor/1"] = Field(alias="schema", description="version of this document")
    robot: Name = Field(description="name of the robot")
    log_file: FilePath | None = Field(
        default=None,
        description="the log, relative to this document's folder; null where it was made in memory",
    )
    robot_file: FilePath | None = Field(
        default=None, description="the nominal robot where another than the log's was given, likewise"
    )
    healthy: bool = Field(description="whether nothing was found that spoils results")
    findings: Findings = Field(description="worst first")
    repaired: FilePath | None = Field(default=None, description="folder of the repaired log")


# ``excite.export/1``: the files that were written for a controller.


class Export(Document):
    """The files that were written for a controller."""

    schema_: Literal["excite.export/1"] = Field(alias="schema", description="version of this document")
    format: Name = Field(description="format of the files")
    files: Annotated[list[FilePath], Field(max_length=MOST_ENTRIES)] = Field(
        description="relative to --out, or to the working folder"
    )


# ``excite.human/1``: a person as measured, and what identification found of the segments.


class TableMass(Block):
    """A segment's mass by two tables."""

    segment: Name = Field(description="name of the segment")
    de_leva_kg: Positive = Field(description="de Leva 1996 [kg]")
    dumas_kg: Positive = Field(description="Dumas 2007 [kg]")


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
    findings: Findings = Field(default=NONE, description="what was wrong with the recordings")
    table: Name = Field(description="table of the nominal masses")
    segments: Annotated[list[TableMass], Field(max_length=MOST_CHANNELS)] = Field(
        description="masses by the tables"
    )
    ground_reaction: Annotated[Mapping[Name, Mapping[Name, ChannelFit]] | None, AS_DOCUMENT] = Field(
        default=None, description="by role of the trials and component, world axes"
    )


# ``excite.journal/1``: the robot and the settings that a campaign was begun with.


class Settings(Block):
    """What a campaign was asked for."""

    n_candidates: Count = Field(description="candidate motions in the first iteration")
    target_rsd: Positive = Field(description="relative standard deviation to reach [percent]")
    max_iterations: Count = Field(description="iterations at most")
    method: Name = Field(description="estimator")
    seed: int = Field(description="of all random numbers")
    on_robot: bool = Field(description="whether it waits for recordings of a real robot")
    minutes: Positive | None = Field(
        default=None, description="of motion in each iteration; null where nobody said [min]"
    )


class Journal(Document):
    """The robot and the settings that a campaign was begun with."""

    schema_: Literal["excite.journal/1"] = Field(alias="schema", description="version of this document")
    robot_hash: Name = Field(description="hash of the robot's files")
    settings: Settings = Field(description="what the campaign was asked for")


# ``excite.model/1``: a robot that was written for a simulator.


class ParameterChange(Block):
    """A parameter before and after."""

    place: Name = Field(description="link or joint")
    parameter: Name = Field(description="its name")
    unit: Name = Field(description="its unit")
    before: Maybe = Field(description="of the nominal model [unit]")
    after: Maybe = Field(description="as it was found [unit]")
    change: Maybe = Field(description="after minus before [unit]")
    percent: Maybe = Field(description="the change, of what was before; null where that was zero")


class LostParameter(Block):
    """Something that was found and that the format has no place for."""

    parameter: Name = Field(description="its name")
    where: Name = Field(description="joint, link or robot")
    value: Maybe = Field(description="as it was found [SI]; null where it is no number")
    why: Text = Field(description="what the format lacks, and what to do")


class FollowedParameters(Block):
    """What became of the torques, read from the files, when each parameter was changed."""

    torque_error: Positive = Field(description="of the files, relative to the largest torque")
    felt: Count = Field(description="number of parameters that torques follow")
    unseen: Names = Field(description="parameters that no torque depends on")
    not_held: Names = Field(description="parameters that the format does not have")


class Model(Document):
    """A robot that was written for a simulator."""

    schema_: Literal["excite.model/1"] = Field(alias="schema", description="version of this document")
    format: Name = Field(description="format of the files")
    robot: Name = Field(description="name of the robot")
    files: Annotated[list[FilePath], Field(max_length=MOST_ENTRIES)] = Field(
        description="relative to this document's folder; the first is the one to open"
    )
    changes: Annotated[list[ParameterChange], Field(max_length=MOST_ENTRIES)] = Field(
        description="all parameters of bodies and joints"
    )
    lost: Annotated[list[LostParameter], Field(max_length=MOST_ENTRIES)] = Field(
        description="what was found and is not in the files"
    )
    notes: Texts = Field(description="what a user of the files should know")
    proof: FollowedParameters = Field(description="that the files are understood as they are meant")


# ``excite.signals/1``: what each step of the signal processing did to one channel.

# A figure has a panel a step; the processing has nine.
_MOST_STEPS = 20
# Curves are written thinned out to 800 points.
_MOST_POINTS = 100_000


class Points(Block):
    """A curve."""

    x: Annotated[list[Number], Field(max_length=_MOST_POINTS)] = Field(description="in the unit of the axis")
    y: Annotated[list[Maybe], Field(max_length=_MOST_POINTS)] = Field(
        description="in the unit of the quantity; null where there is nothing"
    )

    @model_validator(mode="after")
    def _same_length(self) -> Points:
        if len(self.x) != len(self.y):
            raise ValueError(f"x has {len(self.x)} values, y has {len(self.y)}")
        return self


class SignalStep(Block):
    """One step: a signal before and after it."""

    name: Name = Field(description="the step")
    effect: Text = Field(description="what it did, in one sentence")
    quantity: Name = Field(description="what is shown, with its unit")
    axis: Name = Field(description="what it is shown over, with its unit")
    before: Points = Field(description="the signal before the step")
    after: Points = Field(description="the signal after it")
    dots: bool = Field(default=False, description="whether samples are shown one by one")


class Signals(Document):
    """The steps that one trial's channel went through."""

    schema_: Literal["excite.signals/1"] = Field(alias="schema", description="version of this document")
    trial: Name = Field(description="name of the trial")
    channel: Name = Field(description="joint or component of the wrench that is shown")
    steps: Annotated[list[SignalStep], Field(min_length=1, max_length=_MOST_STEPS)] = Field(
        description="in their order"
    )
