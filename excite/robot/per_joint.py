"""Blocks of ``robot.yaml`` that say one number for every joint."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from excite.robot.quantities import (
    Acceleration,
    DriveFriction,
    Gain,
    Jerk,
    Torque,
    TorqueNoise,
    Velocity,
)

# No link, joint or file is named longer; a line on a terminal holds it.
_LONGEST_NAME = 200
# What Linux takes.
_LONGEST_PATH = 4096
_PRINTABLE = r"^[^\x00-\x1f\x7f]*[^\x00-\x20\x7f][^\x00-\x1f\x7f]*$"
Name = Annotated[str, StringConstraints(min_length=1, max_length=_LONGEST_NAME, pattern=_PRINTABLE)]
FileName = Annotated[str, StringConstraints(min_length=1, max_length=_LONGEST_PATH, pattern=_PRINTABLE)]
Source = Annotated[str, Field(min_length=1)]


class Block(BaseModel):
    """A mapping of ``robot.yaml``: what it does not know is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class PerJoint(Block):
    """One number for every joint: ``default``, and exceptions by joint name."""

    default: float | None = None
    joints: dict[str, float] = Field(default_factory=dict)
    source: Source


class Velocities(PerJoint):
    """[rad/s or m/s]"""

    default: Velocity | None = None
    joints: dict[str, Velocity] = Field(default_factory=dict)


class Accelerations(PerJoint):
    """[rad/s² or m/s²]"""

    default: Acceleration | None = None
    joints: dict[str, Acceleration] = Field(default_factory=dict)


class Jerks(PerJoint):
    """[rad/s³ or m/s³]"""

    default: Jerk | None = None
    joints: dict[str, Jerk] = Field(default_factory=dict)


class Torques(PerJoint):
    """[N·m or N]"""

    default: Torque | None = None
    joints: dict[str, Torque] = Field(default_factory=dict)


class Gains(PerJoint):
    """[N·m/rad, N·m·s/rad; for slides N/m, N·s/m]"""

    default: Gain | None = None
    joints: dict[str, Gain] = Field(default_factory=dict)


class TorqueNoises(PerJoint):
    """Standard deviations, positive [N·m or N]."""

    default: TorqueNoise | None = None
    joints: dict[str, TorqueNoise] = Field(default_factory=dict)


class DriveFrictions(PerJoint):
    """[N·m·s/rad, N·m or kg·m²; for slides N·s/m, N or kg]"""

    default: DriveFriction | None = None
    joints: dict[str, DriveFriction] = Field(default_factory=dict)
