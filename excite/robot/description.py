"""The schema of ``robot.yaml``: what a person says about a robot beside its URDF.

Every block that holds numbers also holds a ``source`` that says where they come from.
Lengths are metres, angles radians, forces newtons, torques newton metres, rates hertz.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError, model_validator

from excite.errors import RobotError, raised_as
from excite.formats.documents import read_yaml
from excite.formats.number import shorten_value
from excite.results import Assumed
from excite.robot.mechanisms.closures import CouplingBlock, LoopBlock, TieBlock, TransmissionBlock
from excite.robot.quantities import (
    MAX_FORCE,
    Accelerations,
    Block,
    Coordinate,
    DriveFrictions,
    FileName,
    FrictionCoefficient,
    Gain,
    Gains,
    Gravity,
    Jerks,
    JointValue,
    Length,
    Margin,
    Mass,
    Name,
    Noise,
    Rate,
    Rotation3,
    Share,
    Source,
    TorqueNoises,
    Torques,
    Vector3,
    Velocities,
)
from excite.robot.refusal import robot_error

# What ``robot.yaml`` says of a robot's sensors.


class WrenchSensorBlock(Block):
    """A force-torque sensor in an ankle (``foot_ft``) or a plate in the ground (``force_plate``)."""

    name: Name
    kind: Literal["foot_ft", "force_plate"]
    link: str
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Rotation3 = (0.0, 0.0, 0.0)
    foot: str
    excludes: tuple[str, ...] = ()
    noise_force: Noise
    noise_moment: Noise


class ImuBlock(Block):
    """An inertial measurement unit: its link, and the noise of each axis [rad/s, m/s²]."""

    link: str
    noise_gyro: Noise
    noise_acceleration: Noise


class SensorsBlock(Block):
    """What the robot measures, how often and how well (standard deviations of white noise).

    A base that is free needs ``wrench`` sensors in or under its feet, or ``joint_torque``: without the former the
    contact wrenches are unknown and are taken out of the equations.
    """

    rate_hz: Rate
    noise_position: Noise
    joint_torque: Literal["link_side", "motor_side"] | None = None
    noise_torque: TorqueNoises | None = None
    noise_base_position: Noise = 0.0
    noise_base_orientation: Noise = 0.0
    wrench: tuple[WrenchSensorBlock, ...] = ()
    imu: ImuBlock | None = None
    source: Source


# What ``robot.yaml`` says about collision geometry.

# A hull's planes and corners are compared pairwise: 2000 take seconds and 100 MB.
MAX_HULL_CORNERS = 2000


class CollisionShape(Block):
    """An authored collision primitive on a link; ``size`` is metres: radius | radius, length | x, y, z."""

    link: str
    kind: Literal["sphere", "capsule", "box"]
    size: tuple[Length, ...]
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Rotation3 = (0.0, 0.0, 0.0)


class NearPair(Block):
    """Two links that rest nearer to each other than the margin, and the distance that they keep in its place [m].

    It is negative where their shapes overlap: hulls are larger than what turns in them.
    """

    links: tuple[str, str]
    distance: Coordinate


class CollisionBlock(Block):
    """Collision geometry: convex hulls of the URDF's meshes, or authored primitives.

    ``geometry`` names the elements of the URDF: ``either`` takes ``collision``, and ``visual`` of links without any.
    ``hull_corners`` is how many corners a hull may have; more of them hug the mesh closer, which parts need that
    pass each other within millimetres. ``ignored_pairs`` are pairs of links that may touch or that cannot reach
    each other; ``near_pairs`` keep distances of their own in place of ``margin``. ``stand_ins`` are links whose
    geometry is missing in whole or in part: what cannot be read of it is passed over, and their ``shapes`` stand in for
    it. ``table_height`` is that of the ground or a table [m, in the base's frame]; null: there is none. Where a
    fixed base does not say, it is the plane that it is mounted on. ``cell`` holds the lowest and the highest corner of
    a space that no body leaves [m], in the frame of a fixed base, or of the ground that feet stand on.
    """

    geometry: Literal["collision", "visual", "either", "authored"]
    hull_corners: Annotated[int, Field(ge=32, le=MAX_HULL_CORNERS)] = 96
    shapes: tuple[CollisionShape, ...] = ()
    stand_ins: tuple[str, ...] = ()
    ignored_pairs: tuple[tuple[str, str], ...] = ()
    near_pairs: tuple[NearPair, ...] = ()
    margin: Margin
    table_height: Coordinate | None = None
    cell: tuple[Vector3, Vector3] | None = None
    source: Source


Base = Literal["fixed", "floating", "suspended", "held"]
# Bases whose pose is part of the configuration.
FREE_BASES: tuple[Base, ...] = ("floating", "suspended")


class ModelFile(Block):
    """Where the URDF comes from: a data wheel (``package``) or a file beside ``robot.yaml``.

    ``acknowledged`` names links whose missing or impossible inertia is accepted, with the reason.
    """

    package: Literal["example-robot-data"] | None = None
    path: FileName
    acknowledged: dict[str, Source] = Field(default_factory=dict)
    source: Source


class PositionLimits(Block):
    """Position limits by joint; joints not named keep the URDF's limits."""

    joints: dict[str, tuple[JointValue, JointValue]] = Field(default_factory=dict)
    margin: Margin = 0.0
    source: Source


class PositionTable(Block):
    """A limit of a joint that depends on a position, as linkages and makers' controllers have: linear between ``at``.

    ``limit`` holds of the magnitude of a velocity, acceleration or torque; of the joint's position ``lower`` and
    ``upper`` do. ``over`` is the joint whose position counts, the joint itself where it is left out. Beyond the first
    and last position the nearest value holds. What is stated for all positions holds beside it.
    """

    joint: str
    over: str | None = None
    quantity: Literal["position", "velocity", "acceleration", "torque"]
    at: Annotated[tuple[JointValue, ...], Field(min_length=2)]
    limit: tuple[Annotated[float, Field(gt=0.0, le=MAX_FORCE)], ...] = ()
    lower: tuple[JointValue, ...] = ()
    upper: tuple[JointValue, ...] = ()
    source: Source

    @model_validator(mode="after")
    def _columns(self) -> PositionTable:
        wanted = {"lower", "upper"} if self.quantity == "position" else {"limit"}
        for name in ("limit", "lower", "upper"):
            n = len(self.at) if name in wanted else 0
            if len(getattr(self, name)) != n:
                raise ValueError(
                    f"{self.quantity} of {self.joint}: {name} has to have {n} values, one a position"
                )
        if any(a >= b for a, b in pairwise(self.at)):
            raise ValueError(f"{self.quantity} of {self.joint}: the positions have to increase")
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError(f"{self.quantity} of {self.joint}: a lower limit is not below the upper one")
        if self.quantity == "position" and self.over in {None, self.joint}:
            raise ValueError(f"position of {self.joint}: name the other joint on which it depends, over")
        return self


class LimitsBlock(Block):
    """Limits of every joint; ``velocity`` and ``torque`` fall back on the URDF's where left out."""

    position: PositionLimits
    velocity: Velocities | None = None
    acceleration: Accelerations
    jerk: Jerks
    torque: Torques | None = None
    by_position: tuple[PositionTable, ...] = ()


class FootBlock(Block):
    """A foot: its link and the sole's corners in that link's frame, in order around the sole.

    One corner is a point foot, which carries no moment; two are an edge, three or more a sole. A point foot that is a
    ball has a ``radius``, and its corner is where it touches the ground at rest; where the collision geometry has that
    ball, any point on it will do. Without a posture at rest its ``centre`` says where the ball is.
    """

    name: Name
    link: str
    sole: Annotated[tuple[Vector3, ...], Field(min_length=1)]
    radius: Margin = 0.0
    centre: Vector3 | None = None
    friction: FrictionCoefficient
    source: Source

    @model_validator(mode="after")
    def _ball(self) -> FootBlock:
        if self.radius > 0.0 and len(self.sole) != 1:
            raise ValueError(f"feet {self.name}: a radius goes with a point foot, a sole of one corner")
        return self


class FrictionBlock(Block):
    """Friction and rotor inertia of the drives that a virtual robot is built with.

    ``found`` says that records of this very robot told them: a diagnosis takes them, and no guesses, for its model's.
    """

    viscous: DriveFrictions | None = None
    coulomb: DriveFrictions | None = None
    armature: DriveFrictions | None = None
    found: bool = False


class ControllerBlock(Block):
    """Gains of the joint position servo that the robot runs, for the virtual robot."""

    kp: Gains
    kd: Gains
    rate_hz: Rate = 1000.0


class SegmentsBlock(Block):
    """Readable names of the segments by link, and which are each other's mirror image."""

    names: dict[str, str] = Field(default_factory=dict)
    pairs: tuple[tuple[str, str], ...] = ()
    com_box: dict[str, tuple[Vector3, Vector3]] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _boxes(self) -> SegmentsBlock:
        for link, (lower, upper) in self.com_box.items():
            if any(low >= high for low, high in zip(lower, upper, strict=True)):
                raise ValueError(f"com_box of {link}: the first corner is not below the second")
        return self


class PayloadBlock(Block):
    """What the robot may carry: at most this mass, at a point of a link, or nothing."""

    link: Name
    mass: Mass
    position: Vector3 = (0.0, 0.0, 0.0)


class UncertaintyBlock(Block):
    """The set of robots that margins are wanted for: how far each body may be from what the model says.

    ``mass`` and ``inertia`` are shares, ``com`` is a length along each axis. With ``identified``, a file that
    ``excite identify`` wrote, the set is its ellipsoid of ``sigmas`` standard deviations in place of these.
    """

    mass: Share = 0.1
    com: Margin = 0.01
    inertia: Share = 0.2
    payload: PayloadBlock | None = None
    identified: FileName | None = None
    sigmas: Gain = 2.0
    source: Source | None = None


class PostureBlock(Block):
    """The posture at which motions start and end; joints not named are at zero.

    ``base_rpy`` orients the base in the world; its height is such that the soles touch the ground
    unless ``base_height`` gives it.
    """

    joints: dict[str, JointValue] = Field(default_factory=dict)
    base_height: Coordinate | None = None
    base_rpy: Rotation3 = (0.0, 0.0, 0.0)
    source: Source


MASSES = "masses"
"""What stands under ``assumed`` where no file stated the masses."""


class RobotDescription(Block):
    """The whole of ``robot.yaml``.

    ``base`` says what carries the robot: ``fixed`` to the world, ``floating`` on its feet, ``suspended`` in a harness
    (free, no foot on the ground), ``held`` by a stand (still while the limbs move, no foot on the ground).
    """

    schema_: Literal["excite.robot/1"] = Field(alias="schema")
    name: Name
    title: Name
    model: ModelFile
    base: Base
    locked_joints: dict[str, JointValue] = Field(default_factory=dict)
    loops: tuple[LoopBlock, ...] = ()
    couplings: tuple[CouplingBlock, ...] = ()
    transmissions: tuple[TransmissionBlock, ...] = ()
    posture: PostureBlock
    limits: LimitsBlock
    feet: tuple[FootBlock, ...] = ()
    sensors: SensorsBlock
    drives: FrictionBlock = FrictionBlock()
    controller: ControllerBlock
    segments: SegmentsBlock = SegmentsBlock()
    collision: CollisionBlock
    gravity: Gravity = (0.0, 0.0, -9.81)
    uncertainty: UncertaintyBlock | None = None
    assumed: tuple[Assumed, ...] = ()

    @property
    def has_assumed_masses(self) -> bool:
        """Whether the bodies are a guess from shapes, with the width that ``uncertainty`` states."""
        return self.uncertainty is not None and any(one.what == MASSES for one in self.assumed)

    @model_validator(mode="after")
    def _consistent(self) -> RobotDescription:
        _check_unique([foot.name for foot in self.feet], "feet")
        _check_unique([sensor.name for sensor in self.sensors.wrench], "sensors.wrench")
        ties: tuple[TieBlock | TransmissionBlock, ...] = (*self.loops, *self.couplings, *self.transmissions)
        _check_unique([block.name for block in ties], "loops, couplings and transmissions")
        feet = {foot.name for foot in self.feet}
        for sensor in self.sensors.wrench:
            if sensor.foot not in feet:
                raise ValueError(
                    f"sensors.wrench {sensor.name}: foot {sensor.foot!r} is not among feet {sorted(feet)}"
                )
        if self.base == "floating":
            if not self.feet:
                raise ValueError(
                    "feet: a floating base needs a foot to stand on; else it is suspended or held"
                )
            if not self.sensors.wrench and self.sensors.joint_torque is None:
                raise ValueError(
                    "sensors: a floating-base robot needs contact wrench sensors (wrench) or joint_torque"
                )
        elif self.sensors.joint_torque is None:
            raise ValueError(f"sensors.joint_torque: a {self.base} base needs link_side or motor_side")
        return self


def _check_unique(names: list[str], field: str) -> None:
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{field}: {name!r} stands twice")


@raised_as(RobotError)
def read_description(path: Path) -> RobotDescription:
    """Read and validate a ``robot.yaml``.

    Returns:
        The validated description.

    Raises:
        RobotError: the file is missing, is no YAML, or breaks the schema; names the first field at fault.
    """
    content = read_yaml(path, remedy="write one with excite init-robot")
    try:
        return RobotDescription.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or None
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        if first["input"] is None:
            remedy = "give a value; the comment beside it says which"
            raise robot_error(path, field, f"is not filled in{more}", remedy) from error
        remedy = first.get("ctx", {}).get("remedy", "see `excite init-robot` for the expected form")
        said = first["msg"].removeprefix("Value error, ")
        # What several fields say together names them itself.
        found = f", got {shorten_value(first['input'])}" if field else ""
        raise robot_error(path, field, f"{said}{found}{more}", str(remedy)) from error
