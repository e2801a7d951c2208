"""The numbers of a robot's description: each kind of quantity with the largest that any robot has.

The bounds are orders of magnitude above what is built, so that they stop slips of unit and of typing (a minus too
few in an exponent, degrees, millimetres) and nothing that exists.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, StringConstraints
from pydantic_core import PydanticCustomError, core_schema

# The longest robot arms built, for the space station and for ships' hulls, have less than 100 m.
MAX_LENGTH = 1e3
# Gantries and cable robots travel less than 100 m; 350 is a lift of 0.35 m written in millimetres.
MAX_TRAVEL = 100.0
# Farther than that not even in millimetres: models of mobile robots write 999999 for a slide without limits.
MAX_TRAVEL_STAND_IN = 1e3 * MAX_TRAVEL
# More turns than any encoder of a robot's joint counts.
MAX_ANGLE = 1e3
# Orientations are written within a turn or two; 90, 120, 180 are degrees.
MAX_ORIENTATION = 8.0 * math.pi
# Arms turn twice about themselves at most; of 1181 published models none goes beyond 10 rad but those that write 1e16
# for no limit. Beyond four turns from zero, only whole half turns are taken for angles in rad.
MAX_TURNS = 8.0 * math.pi
# Ten times the weight of the largest excavators' booms.
MAX_MASS = 1e6
# A body of that mass and 30 m.
MAX_INERTIA = 1e9
# Hydraulic presses give 1e9 N; models write 1e4 … 1e6 for a torque without limit.
MAX_FORCE = 1e10
MAX_JERK = 1e12
# A standard deviation larger than what is measured is no measurement; a rate of 1 MHz is no robot's log.
MAX_NOISE = 1e6
# No gear of a robot reduces more.
MAX_RATIO = 1e4
# Exporters write 1e16 for a joint without position limits; what lies beyond MAX_ANGLE is read as that.
MAX_STAND_IN = 1e18


def looks_like_degrees(angle: float) -> bool:
    """Whether an angle that is meant in radians can only be one in degrees.

    Joints of many turns end at whole half turns, in radians multiples of π to two decimals at least; what people
    write in degrees are other numbers, most of them whole.
    """
    if not MAX_TURNS < abs(angle) < MAX_ANGLE:
        return False
    half_turns = round(abs(angle) / math.pi)
    return float(angle).is_integer() or abs(abs(angle) - half_turns * math.pi) > 0.006


def in_radians(angle: float) -> str:
    """The remedy for an angle that looks like degrees."""
    return (
        f"looks like degrees: write radians, {math.radians(angle):.4g}"
        " (a joint of many turns ends at a multiple of π, to two decimals)"
    )


@dataclass(frozen=True)
class Bounded:
    """What pydantic checks of a number.

    Attributes:
        most: largest magnitude.
        unit: its unit, for the error.
        least: ``any`` sign, ``from 0`` or ``above 0``.
        cause: what to do about a larger one.
    """

    most: float
    unit: str
    least: Literal["any", "from 0", "above 0"] = "above 0"
    cause: str = "check its unit and exponent"

    def __get_pydantic_core_schema__(
        self, source: type, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """Check what stands there, read it as a number, check that."""
        number = core_schema.no_info_before_validator_function(_written_value, handler(source))
        return core_schema.no_info_after_validator_function(self._check, number)

    def _check(self, value: float) -> float:
        if not math.isfinite(value):
            raise _refusal_error("is not finite", f"give a number in {self.unit}")
        if abs(value) > self.most:
            raise _refusal_error(f"is more than any robot has ({self.most:.4g} {self.unit})", self.cause)
        if value < 0.0 and self.least != "any":
            raise _refusal_error("is negative", f"give a number {self.least}")
        if value < 1.0 / MAX_STAND_IN and self.least == "above 0":
            raise _refusal_error("is 0" if value == 0.0 else "is next to nothing", "give a number above 0")
        return value


def _written_value(value: Any) -> Any:
    if isinstance(value, bool):
        raise _refusal_error("is true or false, not a number", "give a number")
    if isinstance(value, str) and not value.isascii():
        raise _refusal_error("is no number", "write it with the digits 0 to 9")
    return value


def _refusal_error(what: str, remedy: str) -> PydanticCustomError:
    return PydanticCustomError("quantity", "{what}", {"what": what, "remedy": remedy})


Ratio = Annotated[float, Bounded(MAX_RATIO, "turns a turn", "any")]
Coordinate = Annotated[float, Bounded(MAX_LENGTH, "m", "any", "write metres")]
Length = Annotated[float, Bounded(MAX_LENGTH, "m", "above 0", "write metres")]
JointValue = Annotated[float, Bounded(MAX_ANGLE, "rad or m", "any", "write radians or metres")]
Angle = Annotated[float, Bounded(MAX_ORIENTATION, "rad", "any", "looks like degrees: write radians")]
Margin = Annotated[float, Bounded(MAX_TRAVEL, "rad or m", "from 0", "write radians or metres")]
# Turbines reach 1e4 rad/s; models write 1e4 for a velocity without limit.
Velocity = Annotated[float, Bounded(1e6, "rad/s or m/s")]
# Shocks that destroy gears have 1e6 m/s²; the jerk that builds one up within a microsecond.
Acceleration = Annotated[float, Bounded(1e9, "rad/s² or m/s²")]
Jerk = Annotated[float, Bounded(MAX_JERK, "rad/s³ or m/s³")]
Torque = Annotated[float, Bounded(MAX_FORCE, "N·m or N")]
Mass = Annotated[float, Bounded(MAX_MASS, "kg", "from 0", "write kilograms")]
Share = Annotated[float, Bounded(1.0, "as a share", "from 0", "write 0.1 for 10 %")]
# N·m/rad, N·m·s/rad, kg·m²: a servo that holds a body of MAX_MASS still within its encoder's step.
Gain = Annotated[float, Bounded(1e12, "N·m/rad or N·m·s/rad")]
Noise = Annotated[float, Bounded(MAX_NOISE, "N, N·m, m or rad", "from 0")]
TorqueNoise = Annotated[float, Bounded(MAX_NOISE, "N·m or N")]
Rate = Annotated[float, Bounded(1e6, "Hz")]
# Rubber on rubber has 1 … 2; gecko-like pads some tens.
FrictionCoefficient = Annotated[float, Bounded(100.0, "newtons a newton")]
DriveFriction = Annotated[float, Bounded(MAX_FORCE, "N·m·s/rad, N·m or kg·m²")]
# On the ground [m/s²].
GRAVITY = 9.81
# On the sun's surface it is 274 m/s²; no robot identifies itself above Jupiter's 25.
GravityComponent = Annotated[
    float, Bounded(100.0, "m/s²", "any", "write m/s²; on the ground it is 9.81 downwards")
]

Vector3 = tuple[Coordinate, Coordinate, Coordinate]
Rotation3 = tuple[Angle, Angle, Angle]
Gravity = tuple[GravityComponent, GravityComponent, GravityComponent]


# Blocks of ``robot.yaml`` that say one number for every joint.

_PRINTABLE = r"^[^\x00-\x1f\x7f]*[^\x00-\x20\x7f][^\x00-\x1f\x7f]*$"
# No link, joint or file is named longer; a line on a terminal holds it.
Name = Annotated[str, StringConstraints(min_length=1, max_length=200, pattern=_PRINTABLE)]
# What Linux takes.
FileName = Annotated[str, StringConstraints(min_length=1, max_length=4096, pattern=_PRINTABLE)]
Source = Annotated[str, Field(min_length=1)]


class Block(BaseModel):
    """A mapping of ``robot.yaml``: what it does not know is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


Number = TypeVar("Number", bound=float)


class PerJoint(Block, Generic[Number]):
    """One number for every joint: ``default``, and exceptions by joint name."""

    default: Number | None = None
    joints: dict[str, Number] = Field(default_factory=dict)
    source: Source


class Velocities(PerJoint[Velocity]):
    """[rad/s or m/s]"""


class Accelerations(PerJoint[Acceleration]):
    """[rad/s² or m/s²]"""


class Jerks(PerJoint[Jerk]):
    """[rad/s³ or m/s³]"""


class Torques(PerJoint[Torque]):
    """[N·m or N]"""


class Gains(PerJoint[Gain]):
    """[N·m/rad, N·m·s/rad; for slides N/m, N·s/m]"""


class TorqueNoises(PerJoint[TorqueNoise]):
    """Standard deviations, positive [N·m or N]."""


class DriveFrictions(PerJoint[DriveFriction]):
    """[N·m·s/rad, N·m or kg·m²; for slides N·s/m, N or kg]"""
