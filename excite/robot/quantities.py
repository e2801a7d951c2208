"""The numbers of a robot's description: each kind of quantity with the largest that any robot has.

The bounds are orders of magnitude above what is built, so that they stop slips of unit and of typing (a minus too
few in an exponent, degrees, millimetres) and nothing that exists.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, BeforeValidator
from pydantic_core import PydanticCustomError

# The longest robot arms built, for the space station and for ships' hulls, have less than 100 m.
MAX_LENGTH = 1e3
# Gantries and cable robots travel less than 100 m; 350 is a lift of 0.35 m written in millimetres.
MAX_TRAVEL = 100.0
# More turns than any encoder of a robot's joint counts.
MAX_ANGLE = 1e3
# Orientations are written within a turn or two; 90, 120, 180 are degrees.
MAX_ORIENTATION = 8.0 * math.pi
# Arms turn twice about themselves at most. Beyond four turns, only whole half turns are taken for angles in rad.
MAX_TURNS = 8.0 * math.pi
# Ten times the weight of the largest excavators' booms.
MAX_MASS = 1e6
# A body of that mass and 30 m.
MAX_INERTIA = 1e9
# Hydraulic presses give 1e9 N; models write 1e4 … 1e6 for a torque without limit.
MAX_FORCE = 1e10
# Turbines reach 1e4 rad/s; models write 1e4 for a velocity without limit.
MAX_VELOCITY = 1e6
# Shocks that destroy gears have 1e6 m/s²; the jerk that builds one up within a microsecond.
MAX_ACCELERATION = 1e9
MAX_JERK = 1e12
# N·m/rad, N·m·s/rad, kg·m²: a servo that holds a body of MAX_MASS still within its encoder's step.
MAX_GAIN = 1e12
# A standard deviation larger than what is measured is no measurement; a rate of 1 MHz is no robot's log.
MAX_NOISE = 1e6
MAX_RATE = 1e6
# Rubber on rubber has 1 … 2; gecko-like pads some tens.
MAX_FRICTION = 100.0
# On the sun's surface it is 274 m/s²; no robot identifies itself above Jupiter's 25.
MAX_GRAVITY = 100.0
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


def _number(value: Any) -> Any:
    if isinstance(value, bool):
        raise PydanticCustomError("quantity", "is true or false, not a number", {"remedy": "give a number"})
    if isinstance(value, str) and not value.isascii():
        raise PydanticCustomError("quantity", "is no number", {"remedy": "write it with the digits 0 to 9"})
    return value


def _within(most: float, unit: str, cause: str, sign: bool) -> Callable[[float], float]:
    def check(value: float) -> float:
        if not math.isfinite(value):
            raise PydanticCustomError("quantity", "is not finite", {"remedy": f"give a number in {unit}"})
        if abs(value) > most:
            what = f"is more than any robot has ({most:.4g} {unit})"
            raise PydanticCustomError("quantity", "{what}", {"what": what, "remedy": cause})
        if value < 0.0 and not sign:
            raise PydanticCustomError("quantity", "is negative", {"remedy": "give a number from 0"})
        return value

    return check


def _quantity(
    most: float, unit: str, cause: str = "check its unit and exponent", *, sign: bool = False
) -> Any:
    return Annotated[float, BeforeValidator(_number), AfterValidator(_within(most, unit, cause, sign))]


def _positive(quantity: Any) -> Any:
    return Annotated[quantity, AfterValidator(_above_zero)]


def _above_zero(value: float) -> float:
    if value <= 0.0:
        raise PydanticCustomError("quantity", "is not above 0", {"remedy": "give a positive number"})
    return value


if TYPE_CHECKING:
    Coordinate = Length = JointValue = Angle = Margin = float
    Velocity = Acceleration = Jerk = Torque = Gain = Noise = Rate = FrictionCoefficient = DriveFriction = (
        float
    )
    Gravity = tuple[float, float, float]
else:
    Coordinate = _quantity(MAX_LENGTH, "m", "write metres", sign=True)
    Length = _positive(_quantity(MAX_LENGTH, "m", "write metres"))
    JointValue = _quantity(MAX_ANGLE, "rad or m", "write radians or metres", sign=True)
    Angle = _quantity(MAX_ORIENTATION, "rad", "looks like degrees: write radians", sign=True)
    Margin = _quantity(MAX_TRAVEL, "rad or m", "write radians or metres")
    Velocity = _positive(_quantity(MAX_VELOCITY, "rad/s or m/s"))
    Acceleration = _positive(_quantity(MAX_ACCELERATION, "rad/s² or m/s²"))
    Jerk = _positive(_quantity(MAX_JERK, "rad/s³ or m/s³"))
    Torque = _positive(_quantity(MAX_FORCE, "N·m or N"))
    Gain = _positive(_quantity(MAX_GAIN, "N·m/rad"))
    Noise = _quantity(MAX_NOISE, "N, N·m, m or rad")
    Rate = _positive(_quantity(MAX_RATE, "Hz"))
    FrictionCoefficient = _positive(_quantity(MAX_FRICTION, "N/N"))
    DriveFriction = _positive(_quantity(MAX_FORCE, "N·m·s/rad, N·m or kg·m²"))
    _Component = _quantity(MAX_GRAVITY, "m/s²", "write m/s², about 9.81 on the ground", sign=True)
    Gravity = tuple[_Component, _Component, _Component]

Vector3 = tuple[Coordinate, Coordinate, Coordinate]
Rotation3 = tuple[Angle, Angle, Angle]
