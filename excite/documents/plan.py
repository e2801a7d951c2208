"""``excite.plan/1``: motions that were chosen, and what they excite."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from excite.excitation.conditioning import ConditionNumbers
from excite.finding import Finding
from excite.identification.judgement import Forecast, ParameterOutlook
from excite.results import (
    LEFT_OUT,
    Assumed,
    FilePath,
    InnerPath,
    Name,
    Positive,
    Seconds,
    Stated,
    UnboundedPositive,
)
from excite.safety.refusals import Refused
from excite.safety.verdict import Robustness


@dataclass(frozen=True)
class CandidateCounts(Stated):
    """How many motions were generated, and what became of them.

    Attributes:
        generated: number of candidate motions.
        accepted: number of candidates that passed every check.
        rejected: number of refused candidates by reason.
    """

    generated: int
    accepted: int
    rejected: Mapping[Name, int]


@dataclass(frozen=True)
class SelectedMotion(Stated):
    """A chosen motion.

    Attributes:
        motion: motion file, relative to the document's folder.
        segments: segments that it was chosen for.
        duration_s: duration [s].
    """

    motion: InnerPath
    segments: tuple[Name, ...]
    duration_s: Seconds


@dataclass(frozen=True)
class Stage(Stated):
    """A stage of the planning.

    Attributes:
        stage: its name.
        seconds: how long it took [s].
    """

    stage: Name
    seconds: Seconds


@dataclass(frozen=True)
class OutOfReach(Stated):
    """A parameter that the minutes do not bring to the target.

    Attributes:
        parameter: name of its own column.
        minutes: of motion like this that would; null where none does [min].
    """

    parameter: Name
    minutes: UnboundedPositive


@dataclass(frozen=True)
class CurvePoint(Stated):
    """How far minutes reach.

    Attributes:
        minutes: of motion like the chosen [min].
        reached: number of parameters asked for that they bring to the target.
    """

    minutes: Positive
    reached: int


@dataclass(frozen=True)
class PlanDocument(Stated):
    """Motions that were found safe and chosen because they excite the parameters.

    Attributes:
        robot: name of the robot.
        candidates: what was generated and refused.
        selected: chosen motions, the first served first.
        conditioning: of the chosen motions together.
        stages: time taken, in the order in which the stages ran.
        refused: what refuses candidates, the commonest first.
        robust: by chosen motion, least margins over the robots that it may be.
        rehearsed_load: what the robot carried on its back in the rehearsal, as a share of its mass; null of a robot
            that has nothing to fall from, and where planning was interrupted before it.
        interrupted: whether planning was interrupted: the best of what was accepted by then, not rehearsed.
        validation: motion files that judge the result, relative to the document's folder.
        base_parameters: what the motions promise; empty where the sensors' noise is not stated.
        forecast: what that makes of the target; null where the sensors' noise is not stated.
        minutes: minutes at the robot that motions were chosen within; null where nobody said [min].
        reaches: parameters asked for that are expected to reach the target.
        out_of_reach: the others that were asked for.
        d_efficiency: of the chosen motions' information a second, against the most that any states within the limits
            of an arm could tell; null where no bound was computed.
        undesigned: chosen motions that are as their own generator drew them, for no safe design says more.
        curve: minutes at which one more parameter reaches the target, fewest first; the first entry is the least
            that reaches anything. Approaches between motions come on top.
        as_far_as: what has to hold of shapes that are not known, for what is safe to be so.
        assumed: what no file said of the robot.
        findings: what spoils the robot's description itself, worst first.
        robot_file: ``robot.yaml`` of a robot of one's own, relative to the document's folder.
    """

    SCHEMA = "excite.plan/1"

    robot: Name
    candidates: CandidateCounts
    selected: tuple[SelectedMotion, ...]
    conditioning: ConditionNumbers
    stages: tuple[Stage, ...]
    refused: tuple[Refused, ...] = ()
    robust: Mapping[Name, Robustness] = field(default_factory=dict)
    rehearsed_load: float | None = None
    interrupted: bool = False
    validation: tuple[InnerPath, ...] = ()
    base_parameters: tuple[ParameterOutlook, ...] = ()
    forecast: Forecast | None = None
    minutes: float | None = None
    reaches: tuple[Name, ...] = ()
    out_of_reach: tuple[OutOfReach, ...] = ()
    curve: tuple[CurvePoint, ...] = ()
    d_efficiency: float | None = None
    undesigned: int = 0
    as_far_as: tuple[str, ...] = ()
    assumed: tuple[Assumed, ...] = ()
    findings: tuple[Finding, ...] = ()
    robot_file: FilePath | None = field(default=None, metadata=LEFT_OUT)
