"""``excite.plan/1``: motions that were chosen, and what they excite."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from excite.documents.check import Robust
from excite.documents.document import (
    MOST_CHANNELS,
    MOST_ENTRIES,
    AsFarAs,
    Assumptions,
    Block,
    Count,
    Document,
    FilePath,
    Finding,
    InnerPath,
    Maybe,
    MaybePositive,
    Name,
    Names,
    Number,
    Positive,
    Seconds,
    Text,
)


class Candidates(Block):
    """How many motions were generated, and what became of them."""

    generated: Count = Field(description="number of candidate motions")
    accepted: Count = Field(description="number of candidates that passed every check")
    rejected: Annotated[dict[Name, Count], Field(max_length=MOST_ENTRIES)] = Field(
        description="number of refused candidates by reason"
    )


class Refused(Block):
    """One thing that refuses candidates."""

    reason: Name = Field(description="what is violated")
    where: Text = Field(description="pair of links, joint, foot or contact")
    candidates: Count = Field(description="number of candidates that it refuses")
    worst: Maybe = Field(description="value furthest from the limit [unit]; null where there is no number")
    limit: Maybe = Field(description="what it must not pass [unit]; null where there is no number")
    unit: str = Field(default="", max_length=100, description="unit of both")
    time_s: Maybe = Field(
        default=None, description="when the worst happens in its motion [s]; null if unknown"
    )
    candidate: Text = Field(default="", description="candidate that the worst is of")
    posture: Annotated[list[Number], Field(max_length=MOST_CHANNELS)] | None = Field(
        default=None,
        description="configuration of the worst, a free base first [m, quaternion xyzw, rad]; null if none is known",
    )


class Remedy(Block):
    """The change with which most of the refused candidates pass, counted by trying."""

    change: Text = Field(description="what to do, in words")
    reason: Name = Field(description="reason of the refusals that it takes away")
    where: Names = Field(description="their places")
    passes: Count = Field(description="number of tried candidates that pass with it")
    tried: Count = Field(description="number of refused candidates that were tried with it")


# What a plan says of what refused its candidates, whether it has motions or none.
RobotFile = Annotated[
    FilePath | None,
    Field(description="robot.yaml of a robot of one's own, relative to this document's folder"),
]
AllRefused = Annotated[
    list[Refused],
    Field(max_length=MOST_ENTRIES, description="what refuses candidates, the commonest first"),
]
Help = Annotated[
    Remedy | None,
    Field(description="the change most likely to help; null where none helps or enough candidates are safe"),
]


class SelectedMotion(Block):
    """A chosen motion."""

    motion: InnerPath = Field(description="motion file, relative to this document's folder")
    segments: Names = Field(description="segments that it was chosen for")
    duration_s: Seconds = Field(description="duration [s]")


class SegmentCondition(Block):
    """How evenly a segment is excited."""

    segment: Name = Field(description="readable name of the segment")
    condition: MaybePositive = Field(
        description="condition number of the segment's columns [no unit]; null where it is infinite"
    )


class Conditioning(Block):
    """How well motions excite the base parameters."""

    full: MaybePositive = Field(
        description="condition number of the base columns [no unit]; null where it is infinite"
    )
    log_det: Maybe = Field(
        description="log-determinant of the information matrix [no unit]; null where it is singular"
    )
    n_base_parameters: Count = Field(description="number of base parameters")
    rank: Count | None = Field(default=None, description="number of base parameters that are excited")
    segments: Annotated[list[SegmentCondition], Field(max_length=MOST_CHANNELS)] = Field(
        description="by segment that the sensors see"
    )


class Stage(Block):
    """A stage of the planning."""

    stage: Name = Field(description="name of the stage")
    seconds: Seconds = Field(description="how long it took [s]")


class PlannedParameter(Block):
    """What the motions promise for one base parameter."""

    name: Text = Field(description="the parameter that stands for it")
    expression: Text = Field(description="the whole combination")
    excitable: bool = Field(description="whether any motion can show it")
    excited: bool = Field(description="whether the chosen motions do")
    value: Maybe = Field(description="value in the model [SI]")
    predicted_rsd_percent: MaybePositive = Field(
        description="predicted relative standard deviation [percent]; null where it is not excited"
    )
    essential: bool = Field(description="whether identification is expected to keep it")


class Forecast(Block):
    """How much motion a target takes, as far as the sensors' noise tells before anything is measured."""

    target_rsd_percent: Positive = Field(description="relative standard deviation to reach [percent]")
    seconds: Seconds = Field(description="motion at hand [s]")
    within: Count = Field(description="number of essential parameters that are expected to reach it")
    essential: Count = Field(description="number of parameters expected to be essential")
    needed_s: Annotated[dict[Text, Positive], Field(max_length=MOST_ENTRIES)] = Field(
        description="motion of this kind with which each of them reaches the target [s]"
    )


class OutOfReach(Block):
    """A parameter that the minutes do not bring to the target."""

    parameter: Text = Field(description="name of its own column")
    minutes: MaybePositive = Field(description="of motion like this that would; null where none does")


class Plan(Document):
    """Motions that were found safe and chosen because they excite the parameters."""

    schema_: Literal["excite.plan/1"] = Field(alias="schema", description="version of this document")
    robot: Name = Field(description="name of the robot")
    robot_file: RobotFile = None
    candidates: Candidates = Field(description="what was generated and refused")
    refused: AllRefused = Field(default=[])
    remedy: Help = None
    selected: Annotated[list[SelectedMotion], Field(max_length=MOST_ENTRIES)] = Field(
        description="chosen motions, the first served first"
    )
    validation: Annotated[list[InnerPath], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="motion files that judge the result, relative to this document's folder"
    )
    conditioning: Conditioning = Field(description="of the chosen motions together")
    base_parameters: Annotated[list[PlannedParameter], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="what the motions promise; empty where the sensors' noise is not stated"
    )
    forecast: Forecast | None = Field(
        default=None, description="what that makes of the target; null where the sensors' noise is not stated"
    )
    minutes: MaybePositive = Field(
        default=None,
        description="minutes at the robot that motions were chosen within; null where nobody said",
    )
    reaches: Names = Field(
        default=[], description="parameters asked for that are expected to reach the target"
    )
    out_of_reach: Annotated[list[OutOfReach], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="the others that were asked for"
    )
    as_far_as: AsFarAs = Field(default=[])
    assumed: Assumptions = Field(default=[])
    robust: Annotated[dict[Name, Robust], Field(max_length=MOST_ENTRIES)] = Field(
        default={}, description="by chosen motion, least margins over the robots that it may be"
    )
    findings: Annotated[list[Finding], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="what spoils the robot's description itself, worst first"
    )
    rehearsed_load: Maybe = Field(
        default=None,
        description="what the robot carried on its back in the rehearsal, as a share of its mass; null of a robot "
        "that has nothing to fall from, and where planning was interrupted before it",
    )
    interrupted: bool = Field(
        default=False,
        description="whether planning was interrupted: the best of what was accepted by then, not rehearsed",
    )
    stages: Annotated[list[Stage], Field(max_length=MOST_ENTRIES)] = Field(
        description="time taken, in the order in which the stages ran"
    )


class Refusals(Document):
    """What refuses all candidates of a plan, and the change most likely to help."""

    schema_: Literal["excite.refusals/1"] = Field(alias="schema", description="version of this document")
    robot: Name = Field(description="name of the robot")
    robot_file: RobotFile = None
    generated: Count = Field(description="number of candidate motions, none of which is safe")
    refused: AllRefused
    remedy: Help = None
    assumed: Assumptions = Field(default=[])
