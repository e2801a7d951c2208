"""Proof that a simulator took the identified parameters: its inverse dynamics against their regression."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.atomic import write_bytes
from excite.errors import InputError, NoSolutionError
from excite.export.models.mujoco_places import MujocoNames, mujoco_places
from excite.formats.documents import elements_of
from excite.mujoco_warnings import without_log_file
from excite.regressor.kernels import joint_torque_regressor
from excite.robot.robot import Robot
from excite.robot.urdf.model import urdf_model
from excite.robot.urdf.tree import drop_free_root, hold_planar_root

if TYPE_CHECKING:
    import mujoco

TOLERANCE = 1e-9
"""How far, relative to the largest torque, a written model's inverse dynamics may be off."""

_STATES = 20
_SEED = 7
_FREE = "excite_root"


@dataclass(frozen=True, eq=False)
class States:
    """Random states and the generalised forces that the identified parameters ask for there.

    Attributes:
        q: ``(n, nq)``, v and a ``(n, nv)`` in the robot's layout.
        v: see ``q``.
        a: see ``q``.
        torque: ``(n, nv)``, base in its own frame.
    """

    q: Array
    v: Array
    a: Array
    torque: Array

    def error(self, torque: Array) -> float:
        """Largest difference from ``torque``, relative to the largest torque."""
        return float(np.abs(torque - self.torque).max() / np.abs(self.torque).max())


def random_states(robot: Robot, parameters: Array) -> States:
    """States all over the joints' turn, and the torques of ``parameters`` ``(10·n_segments,)`` in them."""
    random = np.random.default_rng(_SEED)
    q = random.uniform(-np.pi, np.pi, size=(_STATES, robot.model.nq))
    if robot.floating:
        q[:, 3:7] = random.normal(size=(_STATES, 4))
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    v, a = random.normal(size=(2, _STATES, robot.model.nv))
    return States(q, v, a, joint_torque_regressor(robot.model, q, v, a) @ parameters)


def held_joints(robot: Robot, root: ElementTree.Element) -> dict[str, float]:
    """Position of every joint of a URDF that the robot holds still, mimic followers of held ones included."""
    held = dict(robot.description.locked_joints)
    for joint in root.findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None and mimic.get("joint") in held and joint.get("type") != "fixed":
            follow = float(mimic.get("multiplier", "1")) * held[str(mimic.get("joint"))]
            held.setdefault(str(joint.get("name")), follow + float(mimic.get("offset", "0")))
    return held


def pinocchio_error(robot: Robot, text: bytes, parameters: Array) -> float:
    """Relative error of inverse dynamics of a URDF text, read by pinocchio alone, against ``parameters``.

    Raises:
        InputError: the file's joints are not the robot's.
    """
    states = random_states(robot, parameters)
    return states.error(pinocchio_torques(robot, text, states))


def pinocchio_torques(robot: Robot, text: bytes, states: States) -> Array:
    """Inverse dynamics ``(n, nv)`` of the bodies of a URDF text, read by pinocchio alone.

    Raises:
        InputError: the file's joints are not the robot's.
    """
    held = held_joints(robot, elements_of(text))
    raw = urdf_model(_links_apart(text), Path("written model"), floating=robot.floating)
    neutral = pin.neutral(raw)
    ids = [raw.getJointId(name) for name in held]
    for index, value in zip(ids, held.values(), strict=True):
        neutral[raw.joints[index].idx_q :][: raw.joints[index].nq] = _turn_coordinates(
            raw.joints[index].nq, value
        )
    model = pin.buildReducedModel(raw, ids, neutral)
    if list(model.names) != list(robot.model.names):
        raise InputError("its joints are not the robot's", source="written model")
    model.gravity = robot.model.gravity
    data, torque = model.createData(), []
    for q, v, a in zip(states.q, states.v, states.a, strict=True):
        own = np.concatenate(
            [np.zeros(0)]
            + [
                part if len(part) == joint.nq else _turn_coordinates(joint.nq, float(part[0]))
                for joint, part in zip(model.joints[1:], _by_joint(robot, q), strict=True)
            ]
        )
        torque.append(pin.rnea(model, data, own, v, a))
    return np.array(torque)


def _robot_element(text: bytes) -> ElementTree.Element:
    """The ``robot`` element of a URDF text, what carries the robot as it is loaded."""
    root: ElementTree.Element = elements_of(text)
    drop_free_root(root)
    hold_planar_root(root)
    return root


def _links_apart(text: bytes) -> ElementTree.Element:
    """The robot with links that no joint is called like: pinocchio reduces no model in which names stand twice."""
    root = _robot_element(text)
    for element in root.iter():
        if element.tag == "link" and element.get("name"):
            element.set("name", f"{element.get('name')} (link)")
        elif element.tag in {"parent", "child"} and element.get("link"):
            element.set("link", f"{element.get('link')} (link)")
    return root


def _by_joint(robot: Robot, q: Array) -> list[Array]:
    joints = list(robot.model.joints)[1:]
    return [q[joint.idx_q : joint.idx_q + joint.nq] for joint in joints]


def _turn_coordinates(nq: int, value: float) -> Array:
    """Coordinates of a joint that turns without end are cosine and sine."""
    return np.array([np.cos(value), np.sin(value)]) if nq == 2 else np.array([value])


def mujoco_error(robot: Robot, model: mujoco.MjModel, names: MujocoNames, parameters: Array) -> float:
    """Relative error of ``mj_inverse`` of a compiled model against ``parameters``.

    Friction, damping and rotor inertia are left out on both sides, and contacts and limits exert nothing.

    Raises:
        InputError: a joint of the robot is not in the model.
    """
    states = random_states(robot, parameters)
    damping, friction, armature = model.dof_damping.copy(), model.dof_frictionloss.copy(), model.dof_armature
    armature = armature.copy()
    model.dof_damping[:] = model.dof_frictionloss[:] = model.dof_armature[:] = 0.0
    torque = mujoco_torques(robot, model, names, states)
    model.dof_damping[:], model.dof_frictionloss[:], model.dof_armature[:] = damping, friction, armature
    return states.error(torque)


def mujoco_torques(robot: Robot, model: mujoco.MjModel, names: MujocoNames, states: States) -> Array:
    """``mj_inverse`` of a compiled model ``(n, nv)``, damping and rotor inertia included.

    Dry friction, contacts and limits exert nothing; gravity is the robot's.

    Raises:
        InputError: a joint of the robot is not in the model.
    """
    import mujoco

    place = mujoco_places(robot, model, names)
    data, flags, gravity = mujoco.MjData(model), model.opt.disableflags, model.opt.gravity.copy()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model.opt.gravity[:] = robot.model.gravity.linear
    torque = []
    for q, v, a in zip(states.q, states.v, states.a, strict=True):
        place.pose(robot, data, q, v, a)
        mujoco.mj_inverse(model, data)
        force = data.qfrc_inverse[place.v].copy()
        if robot.floating:
            force[:3] = pin.Quaternion(q[3:7]).matrix().T @ force[:3]
        torque.append(force)
    model.opt.disableflags, model.opt.gravity[:] = flags, gravity
    return np.array(torque)


def urdf_in_mujoco(robot: Robot, text: bytes) -> mujoco.MjModel:
    """A URDF compiled by MuJoCo without its geometry, on a free joint where the robot's base floats.

    Raises:
        InputError: MuJoCo refuses it, as it does bodies that move and have no mass.
    """
    import mujoco

    root = _robot_element(text)
    for link in root.findall("link"):
        for kind in ("visual", "collision"):
            for element in link.findall(kind):
                link.remove(element)
    # Settings of MuJoCo's own that a URDF may hold: sizes of its memory, for one.
    for extension in root.findall("mujoco"):
        root.remove(extension)
    for joint in root.findall("joint"):
        for mimic in joint.findall("mimic"):
            joint.remove(mimic)
    if robot.floating:
        ElementTree.SubElement(root, "link", name="world")
        joint = ElementTree.SubElement(root, "joint", name=_FREE, type="floating")
        ElementTree.SubElement(joint, "parent", link="world")
        ElementTree.SubElement(joint, "child", link=robot.base_link)
    try:
        with without_log_file():
            return mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
    except ValueError as error:
        raise InputError(
            f"MuJoCo refuses it ({' '.join(str(error).split())})",
            source="written model",
            remedy="give every moving link mass",
        ) from error


# What is known of a model file that was written.


@dataclass(frozen=True)
class WrittenModel:
    """A model file with identified inertials, and the proof that simulators read it so.

    Attributes:
        path: the file.
        changed: links (or bodies) whose inertial was changed.
        notes: what a user of the file should know, one sentence each.
        pinocchio_error: largest difference between inverse dynamics of the file read by pinocchio and the
            identified parameters' regression, relative to the largest torque; None where not checked.
        mujoco_error: the same for the file read by MuJoCo.
    """

    path: Path
    changed: tuple[str, ...]
    notes: tuple[str, ...]
    pinocchio_error: float | None
    mujoco_error: float | None

    def to_json(self) -> dict[str, Any]:
        """The file's entry in a JSON document."""
        return {
            "file": self.path.name,
            "changed": list(self.changed),
            "notes": list(self.notes),
            "pinocchio_error": self.pinocchio_error,
            "mujoco_error": self.mujoco_error,
        }


def write_verified(content: bytes, model: WrittenModel) -> WrittenModel:
    """Write a model's text where all that read it agree; raises NoSolutionError where one does not (a bug here)."""
    for error in (model.pinocchio_error, model.mujoco_error):
        if error is not None and not error <= TOLERANCE:
            raise NoSolutionError(
                f"{model.path} was not written: read back, its inverse dynamics is off by {error:.1e}",
                remedy="report this with the model",
            )
    write_bytes(model.path, content)
    return model
