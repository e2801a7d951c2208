"""The format of a simulator: how a robot is written in it, how it is read again, and what it has no place for."""

from __future__ import annotations

import os
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar

import numpy as np

from excite.arrays import Array
from excite.export.models.mjcf import MjcfTemplate, read_template
from excite.export.models.parameters import ModelParameters, inconsistent_links
from excite.export.models.verification import States
from excite.export.models.xml_text import Element, XmlText
from excite.robot.robot import Robot
from excite.simulation.drives import Drives, nominal_drives


@dataclass(frozen=True, eq=False)
class Rendered:
    """The files of a robot in a format.

    Attributes:
        files: contents by name in the folder, the one that a simulator opens first.
        notes: what a user of them should know, one sentence each.
        mesh_root: where relative paths in them start while nothing is written yet.
    """

    files: Mapping[str, bytes]
    notes: tuple[str, ...] = ()

    @property
    def main(self) -> str:
        """Name of the file that a simulator opens."""
        return next(iter(self.files))


class LoadedModel(ABC):
    """A robot as it was read again from files, by a reader that shares nothing with their writer.

    Attributes:
        drives: terms of joints that the files hold, ``(n_joints,)`` each in the robot's order.
        servos: terms of servos that they hold, likewise.
    """

    def __init__(self, drives: Mapping[str, Array], servos: Mapping[str, Array] | None = None) -> None:
        self.drives = drives
        self.servos = servos or {}

    @abstractmethod
    def torques(self, states: States) -> Array:
        """Inverse dynamics with all friction and rotor inertia, ``(n, nv)`` in the robot's layout."""


class ModelFormat(ABC):
    """A format for identified robots.

    Attributes:
        name: what users type.
        summary: one line for help texts.
        terms: which of :data:`~excite.export.simulators.model_format.JOINT_TERMS` it holds.
        servo_terms: which of :data:`~excite.export.simulators.model_format.SERVO_TERMS` it holds.
        lacks: by term that it does not hold, what that means in the simulator.
        tolerance: how far torques of what is read again may be off, relative to the largest.
        delay_step_s: what delays in it are whole multiples of; zero where any is held [s].
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    terms: ClassVar[tuple[str, ...]] = ("viscous", "coulomb", "armature")
    servo_terms: ClassVar[tuple[str, ...]] = ()
    lacks: ClassVar[Mapping[str, str]] = {}
    tolerance: ClassVar[float] = 1e-9
    delay_step_s: ClassVar[float] = 0.0

    @abstractmethod
    def render(self, subject: Subject) -> Rendered:
        """The files.

        Raises:
            InputError: the format takes no such robot.
        """

    @abstractmethod
    def load(self, subject: Subject, rendered: Rendered) -> LoadedModel:
        """The robot as the format's reader understands the files; raises InputError where it refuses them.

        Args:
            subject: for the robot's names and joints; none of its values.
            rendered: the files.
        """

    def lost(self, subject: Subject) -> tuple[Lost, ...]:
        """What was found and the format holds in no way of its own, beside what :mod:`lost` says of every format."""
        return ()

    def servo(self, subject: Subject) -> tuple[str, ...]:
        """Terms of servos that files of this subject hold."""
        return self.servo_terms

    def exact(self, subject: Subject) -> bool:
        """Whether torques have to be the found ones, and not only change as they do."""
        return True


# What is written for a simulator: a robot, the parameters that were found for it, and where the files will
# stand.

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
        return self.varied(found=replace(self.found, identified=identified))

    def with_servo(self, name: str, values: Array) -> Subject:
        """The same with another term of the servos, ``(n_joints,)``."""
        return self.varied(servo_values={**self.servo_values, name: values})

    def varied(self, **changes: Any) -> Subject:
        """The same with other attributes than the template, whose reading takes long and is kept."""
        other = replace(self, **changes)
        if "mjcf" in self.__dict__:
            other.__dict__["mjcf"] = self.mjcf
        return other

    def inconsistent(self) -> tuple[str, ...]:
        """Links whose parameters no rigid body has."""
        return inconsistent_links(self.robot, self.parameters)


# Torques of joints beside their bodies'.


def with_friction(robot: Robot, bodies: Array, states: States, drives: Mapping[str, Array]) -> Array:
    """Torques of bodies and drives together, ``(n, nv)``.

    Each joint adds viscous·v + coulomb·sign(v) + armature·a.

    Args:
        robot: the robot.
        bodies: torques of the bodies, ``(n, nv)``.
        states: velocities and accelerations.
        drives: terms, ``(n_joints,)`` each; one that is left out is zero.
    """
    total, base = bodies.copy(), robot.n_base_v
    v, a = states.v[:, base:], states.a[:, base:]
    columns = {"viscous": v, "coulomb": np.sign(v), "armature": a}
    for term, values in drives.items():
        total[:, base:] += columns[term] * values
    return total


# Paths in a model's text that still name the same files where the text stands in another folder.


def relocate_path(name: str, old: Path, new: Path) -> str:
    """A path relative to a folder, as seen from another; one that is absolute, or a URI, as it is."""
    if not name or "://" in name or PurePosixPath(name).is_absolute() or "\0" in name:
        return name
    return Path(os.path.relpath(old.resolve() / name, new.resolve())).as_posix()


def move_attribute(text: XmlText, element: Element, attribute: str, old: Path, new: Path) -> None:
    """Let an attribute that holds a path name the same file from another folder."""
    name = element.attributes.get(attribute, "")
    there = relocate_path(name, old, new)
    if there != name and there.isascii() and not set(there) & set("\"'<>&"):
        text.set(element, **{attribute: there})
