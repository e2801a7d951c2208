"""Numbers that a robot can have: each kind of quantity with bounds that no robot comes near.

The bounds are not limits of good taste. They keep out what is no number, what overflows in a product of a few of
them, and what is right only in another unit. The largest value met in some 1200 published robot models stands beside
each.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator
from pydantic_core import PydanticCustomError


@dataclass(frozen=True)
class Quantity:
    """A kind of quantity.

    Attributes:
        name: what it is, in the plural or as a mass noun.
        unit: its unit.
        most: largest magnitude.
        mistake: the likely cause of a larger one.
    """

    name: str
    unit: str
    most: float
    mistake: str = "check the exponent"


# A crane's boom is 100 m; the largest offset of a joint found is 1.5 m, the largest solid a plane of 200 m.
LENGTH = Quantity("a length", "m", 1e3, "lengths are metres, not millimetres")
# 1573 kg, the base of a robot for payloads of 210 kg.
MASS = Quantity("a mass", "kg", 1e6, "masses are kilograms, not grams")
# 100 kg·m²; a mass of 1e6 kg spread over 1e3 m has 1e12.
INERTIA = Quantity("a moment of inertia", "kg·m²", 1e12, "moments are kg·m², not kg·mm²")
# Roll, pitch and yaw: 4.7 rad. A drum of a thousand turns is 6e3 rad.
ANGLE = Quantity("an angle", "rad", 1e4, "angles are radians, not degrees")
# 1.5 m from one joint to the next; 15 m along a slide.
OFFSET = Quantity("an offset or a travel", "m", 100.0, "it looks like millimetres: give metres")
# 1e16 rad, a propeller that turns without end; also 1e4 rad/s and 5e4 N·m for joints without a limit.
LIMIT = Quantity("a limit", "rad, m, rad/s or N·m", 1e17)
# A factor from inches is 0.0254, from millimetres 0.001; 3 is the largest.
SCALE = Quantity("a scale", "", 1e6)
# 1e4 rad/s, where a file means no limit; a spindle of 100 000 rpm does as much.
VELOCITY = Quantity("a velocity", "rad/s or m/s", 1e5, "velocities are rad/s or m/s")
ACCELERATION = Quantity("an acceleration", "rad/s² or m/s²", 1e7, "accelerations are rad/s² or m/s²")
JERK = Quantity("a jerk", "rad/s³ or m/s³", 1e10, "jerks are rad/s³ or m/s³")
# 5e4 N·m, where a file means no limit.
TORQUE = Quantity("a torque or force", "N·m or N", 1e9, "torques are N·m, not N·mm")
# 1e6 N·m/rad is a stiff servo of an industrial robot.
GAIN = Quantity("a gain", "N·m/rad", 1e12)
# Encoders and torque sensors are read at 1e4 Hz at most.
RATE = Quantity("a rate", "Hz", 1e6, "rates are Hz")
# No jump of the noise of a sensor that says anything.
NOISE = Quantity("a standard deviation", "SI units", 1e6)
FRICTION = Quantity("a coefficient of friction", "", 1e3)
# Jupiter has 25 m/s².
GRAVITY = Quantity("gravity", "m/s²", 100.0, "gravity is m/s², [0, 0, -9.81] on Earth")

TURNS = 4.0 * math.pi
"""Largest position limit of a joint that turns to and fro [rad]: two turns from zero; the largest found is 10 rad."""


def fault(
    value: float, quantity: Quantity, *, least: float | None = None, open_end: bool = False
) -> str | None:
    """What is wrong with a number, in words; None if nothing is.

    Args:
        value: the number.
        quantity: its kind.
        least: smallest allowed value, by default minus the largest magnitude.
        open_end: whether ``least`` itself is too small.
    """
    if not math.isfinite(value):
        return f"is {value}, which is no number"
    if abs(value) > quantity.most:
        unit = f" {quantity.unit}" if quantity.unit else ""
        return f"is {value:g}, more than {quantity.name} of any robot ({quantity.most:g}{unit})"
    if least is not None and (value < least or (open_end and value == least)):
        return f"is {value:g}, {'not above' if open_end else 'below'} {least:g}"
    return None


def looks_like_degrees(*limits: float) -> bool:
    """Whether limits of a joint that turns to and fro are plausible in degrees only [rad]."""
    return TURNS < max(map(abs, limits)) <= 720.0


def endless(*limits: float) -> bool:
    """Whether limits stand for none, as ±1e16 does for a propeller [rad or m]."""
    return max(map(abs, limits)) > ANGLE.most


def _within(
    quantity: Quantity, least: float | None = None, *, open_end: bool = False
) -> Callable[[float], float]:
    def check(value: float) -> float:
        what = fault(value, quantity, least=least, open_end=open_end)
        if what is None:
            return value
        remedy = f"give {quantity.name}" + (f" in {quantity.unit}" if quantity.unit else "")
        if math.isfinite(value) and abs(value) > quantity.most:
            remedy = quantity.mistake
        raise PydanticCustomError("quantity", "{what}", {"what": what, "remedy": remedy})

    return check


def _no_truth_value(value: Any) -> Any:
    # YAML reads yes, on and true as truth values, which would count as 1.
    if isinstance(value, bool):
        raise PydanticCustomError(
            "quantity", "{what}", {"what": f"is {str(value).lower()}", "remedy": "give a number"}
        )
    return value


# The fields of robot.yaml.
_NUMBER = BeforeValidator(_no_truth_value)
Length = Annotated[float, _NUMBER, AfterValidator(_within(LENGTH))]
Size = Annotated[float, _NUMBER, AfterValidator(_within(LENGTH, 0.0, open_end=True))]
Margin = Annotated[float, _NUMBER, AfterValidator(_within(LENGTH, 0.0))]
Angle = Annotated[float, _NUMBER, AfterValidator(_within(ANGLE))]
Velocity = Annotated[float, _NUMBER, AfterValidator(_within(VELOCITY, 0.0, open_end=True))]
Acceleration = Annotated[float, _NUMBER, AfterValidator(_within(ACCELERATION, 0.0, open_end=True))]
Jerk = Annotated[float, _NUMBER, AfterValidator(_within(JERK, 0.0, open_end=True))]
Inertia = Annotated[float, _NUMBER, AfterValidator(_within(INERTIA, 0.0, open_end=True))]
Torque = Annotated[float, _NUMBER, AfterValidator(_within(TORQUE, 0.0, open_end=True))]
Gain = Annotated[float, _NUMBER, AfterValidator(_within(GAIN, 0.0, open_end=True))]
Rate = Annotated[float, _NUMBER, AfterValidator(_within(RATE, 0.0, open_end=True))]
Noise = Annotated[float, _NUMBER, AfterValidator(_within(NOISE, 0.0))]
Friction = Annotated[float, _NUMBER, AfterValidator(_within(FRICTION, 0.0, open_end=True))]
Gravity = Annotated[float, _NUMBER, AfterValidator(_within(GRAVITY))]
