"""MJCF: the author's text with identified physics, or a model made from the robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar
from xml.etree import ElementTree

import numpy as np
from defusedxml.ElementTree import fromstring

from excite.arrays import Array
from excite.export.models.mjcf import exact_text, identified_drives, template_names
from excite.export.models.mjcf_compiled import compile_mjcf, compile_text
from excite.export.models.mujoco_places import MujocoNames, mujoco_places
from excite.export.models.verification import States, mujoco_torques
from excite.export.models.xml_text import Element, XmlText
from excite.export.simulators.model_format import (
    LoadedModel,
    ModelFormat,
    Rendered,
    Subject,
    move_attribute,
    relocate_path,
    with_friction,
)
from excite.robot.robot import Robot
from excite.simulation.mjcf import World, build_spec

if TYPE_CHECKING:
    import mujoco

_OWN_MOTORS = "the author's actuators were left as they are; set it there"
FILTERED = "commands pass a filter of {late:.3g} s, which is how late the motors were found to follow"
_FOLDERS = {"mesh": "meshdir", "hfield": "meshdir", "skin": "meshdir", "texture": "texturedir"}


class MjcfFormat(ModelFormat):
    """A MuJoCo model.

    Of a robot that came as MJCF it is that text: shapes, contacts, defaults, sensors and actuators stay, inertials,
    ``damping``, ``frictionloss`` and ``armature`` change. Of any other it is made here, with a position servo a joint.
    """

    name = "mjcf"
    servo_terms = ("kp", "kd", "torque_limit", "delay")
    lacks: ClassVar[Mapping[str, str]] = {
        "kp": _OWN_MOTORS,
        "kd": _OWN_MOTORS,
        "torque_limit": _OWN_MOTORS,
        "delay": _OWN_MOTORS,
        "velocity_limit": "MuJoCo holds no joint below a speed; keep commands below it",
    }
    summary = "MuJoCo model; of a robot that came as MJCF the author's text is kept (MuJoCo, MJX)"

    def render(self, subject: Subject) -> Rendered:
        """See :class:`ModelFormat`."""
        given = subject.mjcf
        if given is None:
            content = exact_text(model_spec(subject))
            notes = () if subject.delay_s is None else (FILTERED.format(late=subject.delay_s),)
            return Rendered({f"{subject.stem}.xml": content}, notes)
        edit = given.edited(subject.robot, subject.found, drives=True)
        _move_paths(edit.text, given.file.parent, subject.folder)
        return Rendered({f"{subject.stem}.xml": edit.text.edited()}, edit.notes)

    def load(self, subject: Subject, rendered: Rendered) -> LoadedModel:
        """Read by MuJoCo, where paths in it start at the folder that it is for."""
        content = rendered.files[rendered.main]
        names = template_names(subject.robot, {})
        if subject.template is None:
            return LoadedMjcf(subject.robot, compile_text(content, None), names)
        alone = physics_alone(content)
        where = subject.folder / rendered.main
        model = compile_mjcf(content, where) if alone is None else compile_text(alone, None)
        return LoadedMjcf(subject.robot, model, names)

    def servo(self, subject: Subject) -> tuple[str, ...]:
        """A text that is kept keeps its actuators."""
        return self.servo_terms if subject.template is None else ()

    def exact(self, subject: Subject) -> bool:
        """A text that is kept may have springs, and bodies that are some parts in ten thousand off the robot's."""
        return subject.template is None


def model_spec(subject: Subject) -> mujoco.MjSpec:
    """A model made from the robot, with a servo a joint; a delay is the time constant of a filter of its command."""
    import mujoco

    own = identified_drives(subject.robot, subject.found)
    kp, kd, limit = (subject.servo(name) for name in ("kp", "kd", "torque_limit"))
    drives = replace(own, kp=kp, kd=kd, torque_limit=limit)
    spec = build_spec(subject.robot, subject.parameters, drives, World())
    late = subject.servo("delay")
    for name, constant in zip(subject.robot.joint_names, late, strict=True):
        if np.isfinite(constant):
            motor = spec.actuator(name)
            motor.dyntype, motor.dynprm[0] = mujoco.mjtDyn.mjDYN_FILTEREXACT, constant
    return spec


class LoadedMjcf(LoadedModel):
    """A compiled MuJoCo model."""

    def __init__(self, robot: Robot, model: mujoco.MjModel, names: MujocoNames) -> None:
        self._robot, self._model, self._names = robot, model, names
        place = mujoco_places(robot, model, names).v[robot.n_base_v :]
        drives = {
            "viscous": np.asarray(model.dof_damping[place], dtype=float),
            "coulomb": np.asarray(model.dof_frictionloss[place], dtype=float),
            "armature": np.asarray(model.dof_armature[place], dtype=float),
        }
        super().__init__(drives, _servo_terms(model, robot.joint_names))

    def torques(self, states: States) -> Array:
        """MuJoCo's own; dry friction, which it solves as a constraint, is that of a joint that moves."""
        whole = mujoco_torques(self._robot, self._model, self._names, states)
        return with_friction(self._robot, whole, states, {"coulomb": self.drives["coulomb"]})


def _servo_terms(model: mujoco.MjModel, names: tuple[str, ...]) -> dict[str, Array]:
    """Terms of the position servos that are named like their joints; NaN where a joint has none."""
    import mujoco

    rows = np.full((4, len(names)), np.nan)
    for column, name in enumerate(names):
        motor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name)
        if motor >= 0:
            late = model.actuator_dynprm[motor, 0] if model.actuator_dyntype[motor] else np.nan
            gain, bias = model.actuator_gainprm[motor], model.actuator_biasprm[motor]
            rows[:, column] = gain[0], -bias[2], model.actuator_forcerange[motor, 1], late
    return dict(zip(("kp", "kd", "torque_limit", "delay"), rows, strict=True))


def _move_paths(text: XmlText, old: Path, new: Path) -> None:
    """Let a text name the same files from another folder."""
    if old.resolve() == new.resolve():
        return
    for include in text.root.everywhere("include"):
        move_attribute(text, include, "file", old, new)
    compilers = text.root.named("compiler")
    for tag, attribute in _FOLDERS.items():
        if not _file_names(text, tag):
            continue
        stated = next((c for c in compilers if {attribute, "assetdir"} & set(c.attributes)), None)
        if stated is not None:
            name = stated.attributes.get(attribute) or stated.attributes.get("assetdir", "")
            text.set(stated, **{attribute: relocate_path(name or ".", old, new)})
            continue
        for element in text.root.everywhere(tag):
            move_attribute(text, element, "file", old, new)


def _file_names(text: XmlText, tag: str) -> list[Element]:
    return [element for element in text.root.everywhere(tag) if "file" in element.attributes]


# The part of a MuJoCo model that its inverse dynamics depends on: without shapes, it compiles in a
# millisecond.

# What no inverse dynamics without contacts, limits and drives depends on. Tendons go too where nothing of theirs acts.
_ASIDE = (
    "asset",
    "contact",
    "sensor",
    "actuator",
    "keyframe",
    "visual",
    "statistic",
    "custom",
    "equality",
    "extension",
)
_SHAPES = ("geom", "site", "camera", "light")
# Elements that stand for others, whose text is not here.
_ELSEWHERE = ("include", "plugin", "attach", "replicate", "composite", "flexcomp")
# A tendon that acts without being driven.
_ACTS = ("stiffness", "damping", "armature")


def physics_alone(content: bytes) -> bytes | None:
    """A MuJoCo text of bodies, joints and inertials alone; None where its dynamics depend on more than its own text.

    That is so where it includes others, where a body's inertia follows from its shapes, or a tendon acts.
    """
    root = fromstring(content)
    if _depends_on_more(root):
        return None
    for tag in (*_ASIDE, "tendon", "deformable"):
        _remove_elements(root, tag)
    for world in root.findall("worldbody"):
        for parent in [world, *world.iter("body"), *world.iter("frame")]:
            for tag in _SHAPES:
                _remove_elements(parent, tag)
    for default in root.iter("default"):
        for element in list(default):
            if element.tag not in ("default", "joint"):
                default.remove(element)
    return ElementTree.tostring(root)


def _depends_on_more(root: ElementTree.Element) -> bool:
    if any(element.tag in _ELSEWHERE for element in root.iter()):
        return True
    if any("inertiafromgeom" in compiler.attrib for compiler in root.iter("compiler")):
        return True
    tendons = [tendon for group in root.iter("tendon") for tendon in group]
    if any(attribute in tendon.attrib for tendon in tendons for attribute in _ACTS):
        return True
    return any(_weighs_by_shape(world, moves=False) for world in root.iter("worldbody"))


def _weighs_by_shape(parent: ElementTree.Element, *, moves: bool) -> bool:
    """Whether a body in it that moves has the inertia of its shapes; what stands still weighs nothing in torques."""
    for child in parent:
        if child.tag not in ("body", "frame"):
            continue
        driven = moves or child.find("joint") is not None or child.find("freejoint") is not None
        by_shape = child.tag == "body" and child.find("inertial") is None and child.find("geom") is not None
        if (driven and by_shape) or _weighs_by_shape(child, moves=driven):
            return True
    return False


def _remove_elements(parent: ElementTree.Element, tag: str) -> None:
    for element in parent.findall(tag):
        parent.remove(element)
