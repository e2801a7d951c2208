"""The format of a simulator: what is written of a robot, how it is read again, and what the format has no place for."""

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
import pinocchio as pin

from excite.arrays import Array
from excite.errors import RobotError
from excite.export.models.mjcf_template import MjcfTemplate, read_template
from excite.export.models.parameters import inconsistent_links
from excite.export.models.verification import States, pinocchio_torques
from excite.export.models.xml_text import Element, XmlText
from excite.formats.documents import elements_of
from excite.identification.identified_parameters import IdentifiedParameters
from excite.results import Name, Stated
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_shapes
from excite.robot.shapes.shape import Shape
from excite.simulation.mjcf import joint_axis, mechanical_range, segment_inertia
from excite.simulation.true_parameters import Drives, PrincipalInertia, nominal_drives

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


@dataclass(frozen=True, eq=False)
class Rendered:
    """The files of a robot in a format.

    Attributes:
        files: contents by name in the folder, the one that a simulator opens first.
        notes: what a user of them should know, one sentence each.
    """

    files: Mapping[str, bytes]
    notes: tuple[str, ...] = ()

    @property
    def main(self) -> str:
        """Name of the file that a simulator opens."""
        return next(iter(self.files))

    def files_ending(self, suffix: str) -> Rendered:
        """Its files of one kind alone."""
        return Rendered({name: content for name, content in self.files.items() if name.endswith(suffix)})


@dataclass(frozen=True, eq=False)
class LoadedModel:
    """A robot as it was read again from files, by a reader that shares nothing with their writer.

    Attributes:
        torques: its inverse dynamics with all friction and rotor inertia, ``(n, nv)`` in the robot's layout.
        terms: those of :data:`JOINT_TERMS` and :data:`SERVO_TERMS` that the files hold, ``(n_joints,)`` each in the
            robot's order; NaN where a joint has none.
    """

    torques: Array
    terms: Mapping[str, Array]

    @property
    def joint_terms(self) -> dict[str, Array]:
        """Terms of the joints alone."""
        return {name: self.terms[name] for name in JOINT_TERMS if name in self.terms}


class ModelFormat(ABC):
    """A format for identified robots.

    Attributes:
        name: what users type.
        summary: one line for help texts.
        held: by term of :data:`JOINT_TERMS` and :data:`SERVO_TERMS` that it holds, what it is called there.
        lacks: by term that it does not hold, what that means in the simulator.
        tolerance: how far torques of what is read again may be off, relative to the largest.
        delay_step_s: what delays in it are whole multiples of; zero where any is held [s].
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    held: ClassVar[Mapping[str, str]]
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
    def load(self, subject: Subject, rendered: Rendered, states: States) -> LoadedModel:
        """The robot as the format's reader understands the files; raises InputError where it refuses them.

        Args:
            subject: for the robot's names and joints; none of its values.
            rendered: the files.
            states: in which its torques are asked for.
        """

    def servo(self, subject: Subject) -> tuple[str, ...]:
        """Terms of servos that files of this subject hold."""
        return tuple(term for term in SERVO_TERMS if term in self.held)

    def exact(self, subject: Subject) -> bool:
        """Whether torques have to be the found ones, and not only change as they do."""
        return True


# What is written for a simulator: a robot, the parameters that were found for it, and where the files will
# stand.


@dataclass(frozen=True)
class Lost(Stated):
    """Something that was found and that the format has no place for.

    Attributes:
        parameter: its name, such as ``armature``.
        where: joint, link or the whole robot.
        value: as it was found [SI]; null where it is no number.
        why: what the format lacks, and what to do.
    """

    parameter: Name
    where: Name
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
    found: IdentifiedParameters
    folder: Path
    template: Path | None = None
    beyond: tuple[Lost, ...] = ()
    delay_s: float | None = None
    shapes: bool = True
    servo_values: Mapping[str, Array] = field(default_factory=dict)

    @property
    def parameters(self) -> Array:
        """Inertial parameters, ``(10·n_segments,)``, pinocchio's order, joint frames [SI]."""
        return self.found.inertial

    @property
    def drives(self) -> dict[str, float]:
        """Parameters of the drives by name, such as ``viscous.JOINT`` [SI]."""
        return self.found.by_drive()

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
        """A term of all joints for a file that is made anew, one of :data:`JOINT_TERMS` or :data:`SERVO_TERMS`.

        Those of joints are as found, else as the robot's description has them; those of servos are NaN where they are
        not known.
        """
        if name in SERVO_TERMS:
            return self.servo(name)
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
        return self.varied(
            found=replace(self.found, inertial=parameters, drive_names=tuple(own), drives=values)
        )

    def varied(self, **changes: Any) -> Subject:
        """The same with other attributes than the template, whose reading takes long and is kept."""
        other = replace(self, **changes)
        if "mjcf" in self.__dict__:
            other.__dict__["mjcf"] = self.mjcf
        return other

    def inconsistent(self) -> tuple[str, ...]:
        """Links whose parameters no rigid body has."""
        return inconsistent_links(self.robot, self.parameters)


# Readers' parts that several formats have.


def with_friction(robot: Robot, bodies: Array, states: States, terms: Mapping[str, Array]) -> Array:
    """Torques of bodies and drives together, ``(n, nv)``.

    Each joint adds viscous·v + coulomb·sign(v) + armature·a.

    Args:
        robot: the robot.
        bodies: torques of the bodies, ``(n, nv)``.
        states: velocities and accelerations.
        terms: of the joints, ``(n_joints,)`` each; one that is left out is zero, others than those three are not read.
    """
    total, base = bodies.copy(), robot.n_base_v
    v, a = states.v[:, base:], states.a[:, base:]
    for term, column in {"viscous": v, "coulomb": np.sign(v), "armature": a}.items():
        if term in terms:
            total[:, base:] += column * terms[term]
    return total


# By term that a URDF holds: the element of a joint, its attribute there, and what one that is missing stands for.
URDF_TERMS = {
    "viscous": ("dynamics", "damping", 0.0),
    "coulomb": ("dynamics", "friction", 0.0),
    "torque_limit": ("limit", "effort", np.nan),
    "velocity_limit": ("limit", "velocity", np.nan),
}


def load_urdf(robot: Robot, text: bytes | str, states: States) -> LoadedModel:
    """A URDF by pinocchio, the terms that its joints state by the XML's own words."""
    joints = {joint.get("name"): joint for joint in elements_of(text).findall("joint")}
    terms = {}
    for term, (tag, attribute, default) in URDF_TERMS.items():
        elements = (joints[name].find(tag) for name in robot.joint_names)
        values = [default if one is None else float(one.get(attribute, default)) for one in elements]
        terms[term] = np.array(values)
    return LoadedModel(with_friction(robot, pinocchio_torques(robot, text, states), states, terms), terms)


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


# A robot as bodies and joints with all that files say of them, made of a subject alone.

BASE = "base"
"""Name of the body that a fixed base is, where the robot's description has no link there."""


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body in the frame of the joint that carries it.

    Attributes:
        name: its link.
        inertia: mass, centre of mass, principal moments and axes; None of a fixed base without mass.
        pose: of its frame where all joints are at zero, in the world.
        shapes: its collision shapes, in its frame.
    """

    name: str
    inertia: PrincipalInertia | None
    pose: pin.SE3
    shapes: tuple[Shape, ...]


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint between two bodies, and its drive.

    Attributes:
        name: its name.
        parent: index of the body that carries it.
        child: index of the body that it carries, whose frame is its own.
        placement: its frame in the parent's.
        axis: ``(3,)`` in its frame.
        slides: whether it is prismatic.
        range: lower and upper end of its travel [rad or m].
        terms: those of :data:`JOINT_TERMS` and :data:`SERVO_TERMS` that are known [SI].
    """

    name: str
    parent: int
    child: int
    placement: pin.SE3
    axis: Array
    slides: bool
    range: tuple[float, float]
    terms: dict[str, float]


@dataclass(frozen=True, eq=False)
class Tree:
    """Bodies and joints.

    Attributes:
        bodies: the first is the base, fixed or free.
        joints: the others' joints, in the robot's order.
        free: whether the base floats.
        frames: other links, with the body that each is fixed to and its pose in that.
        notes: what is not in it, one sentence each.
    """

    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    free: bool
    frames: tuple[tuple[str, int, pin.SE3], ...]
    notes: tuple[str, ...]


def described_tree(subject: Subject) -> Tree:
    """Bodies and joints of a subject.

    Raises:
        UnphysicalParametersError: a segment's parameters belong to no body.
        InputError: a joint has more than one coordinate.
    """
    robot, model = subject.robot, subject.robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    shapes, notes = _collision_shapes_of(robot) if subject.shapes else ((), ())
    first = 1 if robot.floating else 0
    root = robot.segments[0].link if robot.floating else _root_link(model)
    ten = subject.parameters.reshape(-1, 10)
    bodies = [
        Body(
            robot.segments[joint - 1].link if joint else root,
            segment_inertia(robot, joint, ten[joint - 1]) if joint else _base_inertia(model),
            pin.SE3(data.oMi[joint]),
            tuple(shape for shape in shapes if shape.joint == joint and shape.link != "table"),
        )
        for joint in range(first, model.njoints)
    ]
    terms = {name: subject.written(name) for name in (*JOINT_TERMS, *SERVO_TERMS)}
    joints = []
    for index, name in enumerate(robot.joint_names):
        joint = model.getJointId(name)
        axis, slides = joint_axis(model, joint)
        lower, upper = mechanical_range(robot, joint)
        joints.append(
            Joint(
                name,
                model.parents[joint] - first,
                joint - first,
                pin.SE3(model.jointPlacements[joint]),
                axis,
                slides,
                (lower, upper),
                {term: float(v[index]) for term, v in terms.items() if np.isfinite(v[index])},
            )
        )
    taken = {body.name for body in bodies}
    frames = tuple(
        (str(frame.name), int(frame.parentJoint) - first, pin.SE3(frame.placement))
        for frame in model.frames
        if frame.type == pin.FrameType.BODY and frame.name not in taken and frame.parentJoint >= first
    )
    return Tree(tuple(bodies), tuple(joints), robot.floating, frames, notes)


def _root_link(model: pin.Model) -> str:
    """The link that stands at a fixed base's origin."""
    names = [
        str(frame.name)
        for frame in model.frames
        if frame.type == pin.FrameType.BODY and frame.parentJoint == 0 and frame.placement.isIdentity(1e-12)
    ]
    return next((name for name in names if name not in ("world", "universe")), BASE)


def _base_inertia(model: pin.Model) -> PrincipalInertia | None:
    own = model.inertias[0]
    if own.mass <= 0.0:
        return None
    moments, axes = np.linalg.eigh(own.inertia)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    return PrincipalInertia(float(own.mass), np.array(own.lever), moments, axes)


def _collision_shapes_of(robot: Robot) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """Collision shapes, and what is to be said where there are none."""
    try:
        return collision_shapes(robot), ()
    except RobotError as error:
        return (), (f"it has no shapes: {error.what}",)
