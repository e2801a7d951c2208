"""``excite.check/1``: the independent verdict on motions."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from excite.documents.document import (
    MOST_ENTRIES,
    AsFarAs,
    Assumptions,
    Block,
    Document,
    FilePath,
    Finding,
    Maybe,
    Name,
    Number,
    Text,
)

# A motion has a few kinds of violations at each joint, foot and pair of links.
_MOST_VIOLATIONS = 5 * MOST_ENTRIES
# Joints turn or slide.
_MOST_UNITS = 2


class Margins(Block):
    """Smallest margins over a motion; null or left out where one could not be computed or does not apply."""

    joint_position_rad: Maybe = Field(default=None, description="to the end of the range [rad or m]")
    joint_velocity_rad_s: Maybe = Field(default=None, description="to the velocity limit [rad/s or m/s]")
    joint_acceleration_rad_s2: Maybe = Field(
        default=None, description="to the acceleration limit [rad/s² or m/s²]"
    )
    joint_jerk_rad_s3: Maybe = Field(default=None, description="to the jerk limit [rad/s³ or m/s³]")
    joint_torque_nm: Maybe = Field(default=None, description="to the torque limit [N·m or N]")
    self_collision_m: Maybe = Field(default=None, description="smallest distance between two bodies [m]")
    zmp_m: Maybe = Field(default=None, description="zero-moment point to the edge of the support polygon [m]")


class Violation(Block):
    """One thing that a motion must not do, at the first time at which it does it."""

    kind: Name = Field(description="what is violated")
    time_s: Maybe = Field(description="first time of it [s]; null where it has none")
    where: Text = Field(description="joint, foot, pair of links or coordinate")
    value: Maybe = Field(description="the offending value [SI]; null where it is no finite number")
    limit: Maybe = Field(description="what it must not pass [SI]; null where there is no number")
    unit: Text = Field(default="", description="of value and limit; empty where none is known")


class Nearest(Block):
    """The joint that comes nearest to its limit, of those that slide or of those that turn."""

    where: Name = Field(description="the joint")
    value: Number = Field(description="its margin [unit], negative beyond the limit")
    unit: Name = Field(description="of the margin")


class Rehearsal(Block):
    """What a motion of a standing robot did in simulation, without any load."""

    stands: bool = Field(description="whether it did not fall")
    slip_m: Number = Field(description="largest slip of a foot that stands [m]")
    touches: bool = Field(description="whether parts other than soles touched each other or the ground")
    drive_share: Number = Field(description="largest torque of a drive, of its limit [no unit]")


class Uncertainty(Block):
    """The set of robots that margins are wanted for, as ``robot.yaml`` states it."""

    mass: Number = Field(description="of each body, as a share")
    com: Number = Field(description="centre of mass along each axis [m]")
    inertia: Number = Field(description="principal moments of each body, as a share")
    payload: dict[Name, Any] | None = Field(description="what may be carried: link, mass [kg], position [m]")
    identified: FilePath | None = Field(
        default=None, description="file of an identification, whose ellipsoid stands in place of the shares"
    )
    sigmas: Number = Field(default=2.0, description="standard deviations of that ellipsoid")
    stated: bool = Field(description="whether robot.yaml states it; else it is the default")


class Worst(Block):
    """The least margin over a motion and the set."""

    value: Number = Field(description="the margin [SI], negative beyond the limit")
    limit: Number = Field(description="what it must not be less than [SI]")
    where: Text = Field(description="joint or feet")
    time_s: Number = Field(description="when [s]")


class Robust(Block):
    """Least margins over the robots that it may be; null where one could not be computed or does not apply."""

    uncertainty: Uncertainty = Field(description="the set")
    joint_torque_nm: Maybe = Field(description="to the torque limit [N·m or N]")
    zmp_m: Maybe = Field(description="zero-moment point to the edge of the support polygon [m]")
    friction: Maybe = Field(
        description="horizontal push at the feet that would make them slip, as a share of the vertical force"
    )
    holds: bool = Field(description="whether every limit is kept by every robot of the set")
    decides: bool = Field(description="whether safe asks for that")
    worst: dict[Name, Worst | None] = Field(description="by margin that applies, where and when it is least")


class CheckedMotion(Block):
    """The verdict on one motion."""

    motion: FilePath = Field(description="name of the motion, or the file that it was read from")
    file: FilePath | None = Field(
        default=None, description="the file that it was read from, relative to this document's folder"
    )
    safe: bool = Field(description="whether nothing is violated and every margin could be computed")
    as_far_as: AsFarAs = Field(default=[])
    margins: Margins = Field(description="smallest margins over the motion")
    nearest: dict[Name, Annotated[list[Nearest], Field(max_length=_MOST_UNITS)]] = Field(
        default={}, description="by margin of joints, the nearest to its limit in each unit, smallest first"
    )
    not_applicable: Annotated[list[Name], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="margins that mean nothing for this robot"
    )
    violations: Annotated[list[Violation], Field(max_length=_MOST_VIOLATIONS)] = Field(
        description="in the order of time"
    )
    rehearsal: Rehearsal | None = Field(
        default=None, description="what it did in simulation; left out where that was not tried"
    )
    robust: Robust | None = Field(default=None, description="least margins over the robots that it may be")


class Check(Document):
    """The verdicts on several motions."""

    schema_: Literal["excite.check/1"] = Field(alias="schema", description="version of this document")
    robot: Name | None = Field(default=None, description="name of the robot that shall run them")
    robot_file: FilePath | None = Field(
        default=None, description="its file where it is not a bundled one, relative to this document's folder"
    )
    safe: bool = Field(description="whether every motion is safe and there is at least one")
    motions: Annotated[list[CheckedMotion], Field(max_length=MOST_ENTRIES)] = Field(
        description="one entry a motion"
    )
    assumed: Assumptions = Field(default=[])
    findings: Annotated[list[Finding], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="what spoils the robot's description itself, worst first"
    )
