"""The schema of ``robot.yaml``: what a person says about a robot beside its URDF.

Every block that holds numbers also holds a ``source`` that says where they come from.
Lengths are metres, angles radians, forces newtons, torques newton metres, rates hertz.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from excite.errors import RobotError

Vector3 = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Source = Annotated[str, Field(min_length=1)]


class _Block(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class ModelFile(_Block):
    """Where the URDF comes from: a data wheel (``package``) or a file beside ``robot.yaml``.

    ``acknowledged`` names links whose missing or impossible inertia is accepted, with the reason.
    """

    package: Literal["example-robot-data"] | None = None
    path: str
    acknowledged: dict[str, Source] = {}
    source: Source


class PerJoint(_Block):
    """One number for every joint: ``default``, and exceptions by joint name."""

    default: Positive | None = None
    joints: dict[str, Positive] = {}
    source: Source


class PositionLimits(_Block):
    """Position limits by joint; joints not named keep the URDF's limits."""

    joints: dict[str, tuple[float, float]] = {}
    margin: NonNegative = 0.0
    source: Source


class LimitsBlock(_Block):
    """Limits of every joint; ``velocity`` and ``torque`` fall back on the URDF's where left out."""

    position: PositionLimits
    velocity: PerJoint | None = None
    acceleration: PerJoint
    jerk: PerJoint
    torque: PerJoint | None = None


class FootBlock(_Block):
    """A foot: its link and the sole's corners in that link's frame, in order around the sole."""

    name: str
    link: str
    sole: Annotated[tuple[Vector3, ...], Field(min_length=3)]
    friction: Positive
    source: Source


class WrenchSensorBlock(_Block):
    """A force-torque sensor in an ankle (``foot_ft``) or a plate in the ground (``force_plate``)."""

    name: str
    kind: Literal["foot_ft", "force_plate"]
    link: str
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Vector3 = (0.0, 0.0, 0.0)
    foot: str
    excludes: tuple[str, ...] = ()
    noise_force: NonNegative
    noise_moment: NonNegative


class SensorsBlock(_Block):
    """What the robot measures, how often and how well (standard deviations of white noise)."""

    rate_hz: Positive
    noise_position: NonNegative
    joint_torque: Literal["link_side", "motor_side"] | None = None
    noise_torque: PerJoint | None = None
    noise_base_position: NonNegative = 0.0
    noise_base_orientation: NonNegative = 0.0
    wrench: tuple[WrenchSensorBlock, ...] = ()
    source: Source


class FrictionBlock(_Block):
    """Friction and rotor inertia of the drives that a virtual robot is built with."""

    viscous: PerJoint | None = None
    coulomb: PerJoint | None = None
    armature: PerJoint | None = None


class ControllerBlock(_Block):
    """Gains of the joint position servo that the robot runs, for the virtual robot."""

    kp: PerJoint
    kd: PerJoint
    rate_hz: Positive = 1000.0


class CollisionShape(_Block):
    """An authored collision primitive on a link; ``size`` is metres: radius | radius, length | x, y, z."""

    link: str
    kind: Literal["sphere", "capsule", "box"]
    size: tuple[Positive, ...]
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Vector3 = (0.0, 0.0, 0.0)


class CollisionBlock(_Block):
    """Collision geometry: convex hulls of the URDF's meshes, or authored primitives.

    ``hull_corners`` is how many corners a hull may have; more of them hug the mesh closer, which parts need that
    pass each other within millimetres. ``ignored_pairs`` are pairs of links that may touch or that cannot reach
    each other.
    """

    geometry: Literal["collision", "visual", "authored"]
    hull_corners: Annotated[int, Field(ge=32)] = 96
    shapes: tuple[CollisionShape, ...] = ()
    ignored_pairs: tuple[tuple[str, str], ...] = ()
    margin: NonNegative
    table_height: float | None = None
    source: Source


class SegmentsBlock(_Block):
    """Readable names of the segments by link, and which are each other's mirror image."""

    names: dict[str, str] = {}
    pairs: tuple[tuple[str, str], ...] = ()
    com_box: dict[str, tuple[Vector3, Vector3]] = {}


class PostureBlock(_Block):
    """The posture at which motions start and end; joints not named are at zero.

    ``base_rpy`` orients the base in the world; its height is such that the soles touch the ground
    unless ``base_height`` gives it.
    """

    joints: dict[str, float] = {}
    base_height: float | None = None
    base_rpy: Vector3 = (0.0, 0.0, 0.0)
    source: Source


class RobotDescription(_Block):
    """The whole of ``robot.yaml``."""

    schema_: Literal["excite.robot/1"] = Field(alias="schema")
    name: str
    title: str
    model: ModelFile
    base: Literal["fixed", "floating"]
    locked_joints: dict[str, float] = {}
    posture: PostureBlock
    limits: LimitsBlock
    feet: tuple[FootBlock, ...] = ()
    sensors: SensorsBlock
    drives: FrictionBlock = FrictionBlock()
    controller: ControllerBlock
    segments: SegmentsBlock = SegmentsBlock()
    collision: CollisionBlock
    gravity: Vector3 = (0.0, 0.0, -9.81)

    @model_validator(mode="after")
    def _consistent(self) -> RobotDescription:
        feet = {foot.name for foot in self.feet}
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


def read_description(path: Path) -> RobotDescription:
    """Read and validate a ``robot.yaml``.

    Args:
        path: the file.

    Returns:
        The validated description.

    Raises:
        RobotError: the file is missing, is no YAML, or breaks the schema; names the first field at fault.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RobotError(f"cannot be read ({error})", source=path, remedy="check the path") from error
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        line = str(error).replace("\n", " ")
        raise RobotError(f"is not valid YAML ({line})", source=path, remedy="mend the syntax") from error
    if not isinstance(content, dict):
        raise RobotError("is not a mapping", source=path, remedy="write one with excite init-robot")
    try:
        return RobotDescription.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or None
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        if first["input"] is None:
            raise RobotError(
                f"is not filled in{more}",
                source=path,
                field=field,
                remedy="give a value; the comment beside it says which",
            ) from error
        raise RobotError(
            f"{first['msg']}, got {_shorten(first['input'])}{more}",
            source=path,
            field=field,
            remedy="see `excite init-robot` for the expected form",
        ) from error


def _shorten(value: object, length: int = 60) -> str:
    text = repr(value).replace("\n", " ")
    return text if len(text) <= length else text[: length - 1] + "…"
