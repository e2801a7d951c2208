"""The schema of ``robot.yaml``: what a person says about a robot beside its URDF.

Every block that holds numbers also holds a ``source`` that says where they come from.
Lengths are metres, angles radians, forces newtons, torques newton metres, rates hertz.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from excite.errors import RobotError
from excite.reading.yaml_document import read_yaml
from excite.robot.quantities import (
    Acceleration,
    Angle,
    Friction,
    Gain,
    Gravity,
    Inertia,
    Jerk,
    Length,
    Margin,
    Noise,
    Rate,
    Size,
    Torque,
    Velocity,
)

Place = tuple[Length, Length, Length]
Turn = tuple[Angle, Angle, Angle]
Source = Annotated[str, Field(min_length=1)]
Name = Annotated[str, Field(min_length=1)]
_Number = TypeVar("_Number", bound=float)


# More corners than that no distance computation is meant for; the largest number in use is 400.
MOST_CORNERS = 10_000


class _Block(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class ModelFile(_Block):
    """Where the URDF comes from: a data wheel (``package``) or a file beside ``robot.yaml``.

    ``acknowledged`` names links whose missing or impossible inertia is accepted, with the reason.
    """

    package: Literal["example-robot-data"] | None = None
    path: Name
    acknowledged: dict[str, Source] = {}
    source: Source


class PerJoint(_Block, Generic[_Number]):
    """One number for every joint: ``default``, and exceptions by joint name."""

    default: _Number | None = None
    joints: dict[str, _Number] = {}
    source: Source


class PositionLimits(_Block):
    """Position limits by joint; joints not named keep the URDF's limits."""

    joints: dict[str, tuple[Angle, Angle]] = {}
    margin: Margin = 0.0
    source: Source


class LimitsBlock(_Block):
    """Limits of every joint; ``velocity`` and ``torque`` fall back on the URDF's where left out."""

    position: PositionLimits
    velocity: PerJoint[Velocity] | None = None
    acceleration: PerJoint[Acceleration]
    jerk: PerJoint[Jerk]
    torque: PerJoint[Torque] | None = None


class FootBlock(_Block):
    """A foot: its link and the sole's corners in that link's frame, in order around the sole."""

    name: Name
    link: Name
    sole: Annotated[tuple[Place, ...], Field(min_length=3)]
    friction: Friction
    source: Source


class WrenchSensorBlock(_Block):
    """A force-torque sensor in an ankle (``foot_ft``) or a plate in the ground (``force_plate``)."""

    name: Name
    kind: Literal["foot_ft", "force_plate"]
    link: Name
    xyz: Place = (0.0, 0.0, 0.0)
    rpy: Turn = (0.0, 0.0, 0.0)
    foot: str
    excludes: tuple[str, ...] = ()
    noise_force: Noise
    noise_moment: Noise


class SensorsBlock(_Block):
    """What the robot measures, how often and how well (standard deviations of white noise)."""

    rate_hz: Rate
    noise_position: Noise
    joint_torque: Literal["link_side", "motor_side"] | None = None
    noise_torque: PerJoint[Torque] | None = None
    noise_base_position: Noise = 0.0
    noise_base_orientation: Noise = 0.0
    wrench: tuple[WrenchSensorBlock, ...] = ()
    source: Source


class FrictionBlock(_Block):
    """Friction and rotor inertia of the drives that a virtual robot is built with."""

    viscous: PerJoint[Gain] | None = None
    coulomb: PerJoint[Torque] | None = None
    armature: PerJoint[Inertia] | None = None


class ControllerBlock(_Block):
    """Gains of the joint position servo that the robot runs, for the virtual robot."""

    kp: PerJoint[Gain]
    kd: PerJoint[Gain]
    rate_hz: Rate = 1000.0


class CollisionShape(_Block):
    """An authored collision primitive on a link; ``size`` is metres: radius | radius, length | x, y, z."""

    link: str
    kind: Literal["sphere", "capsule", "box"]
    size: tuple[Size, ...]
    xyz: Place = (0.0, 0.0, 0.0)
    rpy: Turn = (0.0, 0.0, 0.0)


class CollisionBlock(_Block):
    """Collision geometry: convex hulls of the URDF's meshes, or authored primitives.

    ``hull_corners`` is how many corners a hull may have; more of them hug the mesh closer, which parts need that
    pass each other within millimetres. ``ignored_pairs`` are pairs of links that may touch or that cannot reach
    each other.
    """

    geometry: Literal["collision", "visual", "authored"]
    hull_corners: Annotated[int, Field(ge=32, le=MOST_CORNERS)] = 96
    shapes: tuple[CollisionShape, ...] = ()
    ignored_pairs: tuple[tuple[str, str], ...] = ()
    margin: Margin
    table_height: Length | None = None
    source: Source


class SegmentsBlock(_Block):
    """Readable names of the segments by link, and which are each other's mirror image."""

    names: dict[str, str] = {}
    pairs: tuple[tuple[str, str], ...] = ()
    com_box: dict[str, tuple[Place, Place]] = {}


class PostureBlock(_Block):
    """The posture at which motions start and end; joints not named are at zero.

    ``base_rpy`` orients the base in the world; its height is such that the soles touch the ground
    unless ``base_height`` gives it.
    """

    joints: dict[str, Angle] = {}
    base_height: Length | None = None
    base_rpy: Turn = (0.0, 0.0, 0.0)
    source: Source


class RobotDescription(_Block):
    """The whole of ``robot.yaml``."""

    schema_: Literal["excite.robot/1"] = Field(alias="schema")
    name: Name
    title: str
    model: ModelFile
    base: Literal["fixed", "floating"]
    locked_joints: dict[str, Angle] = {}
    posture: PostureBlock
    limits: LimitsBlock
    feet: tuple[FootBlock, ...] = ()
    sensors: SensorsBlock
    drives: FrictionBlock = FrictionBlock()
    controller: ControllerBlock
    segments: SegmentsBlock = SegmentsBlock()
    collision: CollisionBlock
    gravity: tuple[Gravity, Gravity, Gravity] = (0.0, 0.0, -9.81)

    @model_validator(mode="after")
    def _consistent(self) -> RobotDescription:
        feet = {foot.name for foot in self.feet}
        _once("feet", [foot.name for foot in self.feet])
        _once("sensors.wrench", [sensor.name for sensor in self.sensors.wrench])
        for link, (low, high) in self.segments.com_box.items():
            if any(below > above for below, above in zip(low, high, strict=True)):
                raise ValueError(f"segments.com_box.{link}: the first corner {low} is not below {high}")
        for sensor in self.sensors.wrench:
            if sensor.foot not in feet:
                raise ValueError(
                    f"sensors.wrench {sensor.name}: foot {sensor.foot!r} is not among feet {sorted(feet)}"
                )
        if self.base == "fixed" and self.sensors.joint_torque is None:
            raise ValueError("sensors.joint_torque: a fixed-base robot needs link_side or motor_side")
        if self.base == "floating" and not self.sensors.wrench:
            raise ValueError("sensors.wrench: a floating-base robot needs at least one contact wrench sensor")
        return self


def _once(field: str, names: list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{field}: {name!r} occurs twice")


def read_description(path: Path) -> RobotDescription:
    """Read and validate a ``robot.yaml``.

    Args:
        path: the file.

    Returns:
        The validated description.

    Raises:
        RobotError: the file is missing, is no YAML, or breaks the schema; names the first field at fault.
    """
    content = read_yaml(path, error=RobotError, remedy="write one with excite init-robot")
    return validated(content, path)


def validated(content: dict[str, Any], path: Path) -> RobotDescription:
    """The description that a mapping holds; errors as for :func:`read_description`, ``path`` its source."""
    try:
        return RobotDescription.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or None
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        what = f"{first['msg']}, got {_shorten(first['input'])}{more}"
        remedy = "see `excite init-robot` for the expected form"
        if first["type"] == "quantity":
            what, remedy = f"{first['msg']}{more}", first["ctx"]["remedy"]
        elif first["input"] is None:
            what, remedy = f"is not filled in{more}", "give a value; the comment beside it says which"
        raise RobotError(what, source=path, field=field, remedy=remedy) from error


def _shorten(value: object, length: int = 60) -> str:
    text = repr(value).replace("\n", " ")
    return text if len(text) <= length else text[: length - 1] + "…"
