"""What is written for a simulator: a robot, the parameters that were found for it, and where the files will stand."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.export.models.bodies import inconsistent_links
from excite.export.models.mjcf_template import MjcfTemplate, read_template
from excite.export.models.parameters import ModelParameters
from excite.robot.robot import Robot
from excite.simulation.drives import Drives, nominal_drives

JOINT_TERMS = {"viscous": "N·m·s/rad", "coulomb": "N·m", "armature": "kg·m²"}
"""What simulators know of a joint beside its bodies, and its unit; the rest of what is identified they do not have."""

SERVO_TERMS = {
    "kp": "N·m/rad",
    "kd": "N·m·s/rad",
    "torque_limit": "N·m",
    "velocity_limit": "rad/s",
    "delay": "s",
}
"""What simulators know of the servo of a joint; of sliding joints with N and m in place of N·m and rad."""


@dataclass(frozen=True)
class Lost:
    """Something that a format has no place for.

    Attributes:
        parameter: its name, such as ``armature``.
        where: joint, link or the whole robot.
        value: what was found [SI]; None where it is no number.
        why: what the format lacks, and what that means.
    """

    parameter: str
    where: str
    value: float | None
    why: str

    def __str__(self) -> str:
        value = "" if self.value is None else f" ({self.value:.4g})"
        return f"{self.parameter} of {self.where}{value}: {self.why}"


@dataclass(frozen=True, eq=False)
class Subject:
    """A robot as it is to be written.

    Attributes:
        robot: the robot, nominal.
        found: the parameters of its bodies and drives that were found.
        folder: folder that the files will stand in; paths of meshes are relative to it.
        template: the MuJoCo model that the robot came as; None for another kind of model.
        beyond: what was found and what no robot model has, such as an encoder's zero.
        delay_s: how late the joints' servos follow what they are told; None where that was not found [s].
        shapes: whether files get shapes, which no torque depends on.
        servo_values: terms of servos, ``(n_joints,)`` each, in place of the robot's own.
    """

    robot: Robot
    found: ModelParameters
    folder: Path
    template: Path | None = None
    beyond: tuple[Lost, ...] = ()
    delay_s: float | None = None
    shapes: bool = True
    servo_values: Mapping[str, Array] = field(default_factory=dict)

    @property
    def parameters(self) -> Array:
        """Inertial parameters, ``(10·n_segments,)``, pinocchio's order, joint frames [SI]."""
        return self.found.parameters

    @property
    def drives(self) -> dict[str, float]:
        """Parameters of the drives by name, such as ``viscous.JOINT`` [SI]."""
        return self.found.identified.by_drive()

    @property
    def stem(self) -> str:
        """Name of the files, without suffix."""
        return re.sub(r"[^A-Za-z0-9_-]", "_", self.robot.name) or "robot"

    def term(self, name: str) -> Array:
        """A term of all joints as it was found, ``(n_joints,)``; NaN where it was not, or no joint has it."""
        values = (self.drives.get(f"{name}.{joint}", np.nan) for joint in self.robot.joint_names)
        return np.array([value if value >= 0.0 else np.nan for value in values])

    @cached_property
    def declared(self) -> Drives:
        """The drives that the robot's own description states."""
        return nominal_drives(self.robot)

    def written(self, name: str) -> Array:
        """A term of all joints for a file that is made anew: as found, else as the robot's description has it."""
        found = self.term(name)
        return np.asarray(np.where(np.isfinite(found), found, getattr(self.declared, name)))

    def servo(self, name: str) -> Array:
        """A term of all joints' servos, one of :data:`SERVO_TERMS`, ``(n_joints,)``; NaN where it is not known."""
        if name in self.servo_values:
            return self.servo_values[name]
        if name == "velocity_limit":
            return self.robot.limits.velocity
        if name == "delay":
            late = np.nan if self.delay_s is None else self.delay_s
            return np.full(self.robot.n_joints, late)
        return np.asarray(getattr(self.declared, name))

    @cached_property
    def mjcf(self) -> MjcfTemplate | None:
        """The MuJoCo model that the robot came as, read; raises InputError where it cannot be."""
        return None if self.template is None else read_template(self.robot, self.template, {})

    def but(self, parameters: Array, drives: Mapping[str, float]) -> Subject:
        """The same with other values; what is not in ``drives`` keeps its own."""
        own = self.drives | dict(drives)
        values = np.array(list(own.values()))
        identified = replace(
            self.found.identified, inertial=parameters, drive_names=tuple(own), drives=values
        )
        other = replace(self, found=replace(self.found, identified=identified))
        # What was read of the template does not depend on values, and takes long.
        if "mjcf" in self.__dict__:
            other.__dict__["mjcf"] = self.mjcf
        return other

    def with_servo(self, name: str, values: Array) -> Subject:
        """The same with another term of the servos, ``(n_joints,)``."""
        other = replace(self, servo_values={**self.servo_values, name: values})
        if "mjcf" in self.__dict__:
            other.__dict__["mjcf"] = self.mjcf
        return other

    def inconsistent(self) -> tuple[str, ...]:
        """Links whose parameters no rigid body has."""
        return inconsistent_links(self.robot, self.parameters)
