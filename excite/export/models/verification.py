"""Proof that a simulator took the identified parameters: its inverse dynamics against their regression."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.atomic import write_bytes
from excite.errors import InputError, NoSolutionError
from excite.formats.documents import elements_of
from excite.mujoco_warnings import without_log_file
from excite.regressor.kernels import joint_torque_regressor
from excite.results import HIDDEN, Stated, stated
from excite.robot.loading import model_file
from excite.robot.robot import Robot
from excite.robot.urdf.reading import parse_urdf, urdf_model
from excite.robot.urdf.tree import drop_free_root, hold_planar_root
from excite.simulation.coordinates import position_to_mujoco, velocity_to_mujoco

if TYPE_CHECKING:
    import mujoco

TOLERANCE = 1e-9
"""How far, relative to the largest torque, a written model's inverse dynamics may be off."""

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
    random, n = np.random.default_rng(7), 20
    q = random.uniform(-np.pi, np.pi, size=(n, robot.model.nq))
    if robot.floating:
        q[:, 3:7] = random.normal(size=(n, 4))
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    v, a = random.normal(size=(2, n, robot.model.nv))
    return States(q, v, a, joint_torque_regressor(robot.model, q, v, a) @ parameters)


def held_joints(robot: Robot) -> dict[str, float]:
    """Position of every joint of the robot's URDF that it holds still, mimic followers of held ones included."""
    held = dict(robot.description.locked_joints)
    for joint in parse_urdf(model_file(robot)).findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None and mimic.get("joint") in held and joint.get("type") != "fixed":
            follow = float(mimic.get("multiplier", "1")) * held[str(mimic.get("joint"))]
            held.setdefault(str(joint.get("name")), follow + float(mimic.get("offset", "0")))
    return held


def pinocchio_torques(robot: Robot, text: bytes | str, states: States) -> Array:
    """Inverse dynamics ``(n, nv)`` of the bodies of a URDF text, read by pinocchio alone.

    Raises:
        InputError: the file's joints are not the robot's.
    """
    root = _robot_element(text)
    for element in list(root.iter()):
        # No link is called like a joint: pinocchio reduces no model in which names stand twice.
        if element.tag == "link" and element.get("name"):
            element.set("name", f"{element.get('name')} (link)")
        elif element.tag in {"parent", "child"} and element.get("link"):
            element.set("link", f"{element.get('link')} (link)")
        elif element.get("type") == "continuous":
            # One coordinate, as the robot has it, not a cosine and a sine.
            element.set("type", "revolute")
            if element.find("limit") is None:
                ElementTree.SubElement(element, "limit", lower="0", upper="0", effort="0", velocity="0")
    raw = urdf_model(root, Path("written model"), floating=robot.floating)
    held = {name: value for name, value in held_joints(robot).items() if raw.existJointName(name)}
    posture = pin.neutral(raw)
    for name, value in held.items():
        posture[raw.joints[raw.getJointId(name)].idx_q] = value
    model = pin.buildReducedModel(raw, [raw.getJointId(name) for name in held], posture)
    if list(model.names) != list(robot.model.names):
        raise InputError("its joints are not the robot's", source="written model")
    model.gravity = robot.model.gravity
    data, rows = model.createData(), zip(states.q, states.v, states.a, strict=True)
    return np.array([pin.rnea(model, data, *row) for row in rows])


def _robot_element(text: bytes | str) -> ElementTree.Element:
    """The ``robot`` element of a URDF text, what carries the robot as it is loaded."""
    root: ElementTree.Element = elements_of(text)
    drop_free_root(root)
    hold_planar_root(root)
    return root


@dataclass(frozen=True, eq=False)
class MujocoPlaces:
    """Where a robot's coordinates stand in those of a MuJoCo model, whose names and order may be others.

    Attributes:
        q: ``(nq,)`` places in ``qpos``.
        v: ``(nv,)`` places in ``qvel``.
        start: ``(model.nq,)`` added to ``qpos``: zero of the robot's joints, position of all others.
        n_dof: length of ``qvel``.
    """

    q: NDArray[np.intp]
    v: NDArray[np.intp]
    start: Array
    n_dof: int

    def mujoco_state(self, robot: Robot, q: Array, v: Array) -> tuple[Array, Array]:
        """MuJoCo's ``qpos`` and ``qvel`` for the robot's ``q`` and ``v`` (base twist in the base frame)."""
        qpos, qvel = self.start.copy(), np.zeros(self.n_dof)
        qpos[self.q] += position_to_mujoco(q, floating=robot.floating)
        qvel[self.v] = velocity_to_mujoco(q, v, floating=robot.floating)
        return qpos, qvel

    def mujoco_acceleration(self, robot: Robot, q: Array, v: Array, a: Array) -> Array:
        """MuJoCo's ``qacc`` likewise."""
        base, qacc = a.copy(), np.zeros(self.n_dof)
        if robot.floating:
            base[:3] += np.cross(v[3:6], v[:3])
        qacc[self.v] = velocity_to_mujoco(q, base, floating=robot.floating)
        return qacc


def mujoco_places(
    robot: Robot,
    model: mujoco.MjModel,
    names: Mapping[str, str] | None = None,
    source: object = "MuJoCo model",
) -> MujocoPlaces:
    """Find the robot's joints in a MuJoCo model.

    Args:
        robot: the robot.
        model: the model.
        names: names of links and joints in it, where they are not the robot's.
        source: what to name in errors.

    Raises:
        InputError: a joint, or the free joint of a base that floats, is not there.
    """
    import mujoco

    def joint(name: str) -> int:
        return int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name))

    def lacking(what: str) -> InputError:
        remedy = "give a model of the same robot, or map its names to the model's"
        return InputError(f"has no {what} of robot {robot.name!r}", source=source, remedy=remedy)

    names = names or {}
    q: list[int] = []
    v: list[int] = []
    start = np.array(model.qpos0)
    for name, value in held_joints(robot).items():
        if joint(name) >= 0:
            start[model.jnt_qposadr[joint(name)]] += value
    if robot.floating:
        free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        base = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, names.get(robot.base_link, robot.base_link))
        own = [index for index in free if model.jnt_bodyid[index] == base]
        if not len(free):
            raise lacking("free joint")
        first = (own or free)[0]
        q += range(model.jnt_qposadr[first], model.jnt_qposadr[first] + 7)
        v += range(model.jnt_dofadr[first], model.jnt_dofadr[first] + 6)
        start[q] = 0.0
    for name in robot.joint_names:
        index = joint(names.get(name, name))
        if index < 0:
            raise lacking(f"joint {names.get(name, name)!r}")
        q.append(model.jnt_qposadr[index])
        v.append(model.jnt_dofadr[index])
    return MujocoPlaces(np.array(q), np.array(v), start, int(model.nv))


def mujoco_torques(
    robot: Robot,
    model: mujoco.MjModel,
    states: States,
    names: Mapping[str, str] | None = None,
    *,
    drives: bool = True,
) -> Array:
    """``mj_inverse`` of a compiled model ``(n, nv)``.

    Dry friction, contacts and limits exert nothing; gravity is the robot's.

    Args:
        robot: the robot.
        model: the model; its gravity, flags and, without ``drives``, joints' terms are changed.
        states: positions, velocities and accelerations.
        names: as for :func:`mujoco_places`.
        drives: whether damping and rotor inertia exert theirs.

    Raises:
        InputError: a joint of the robot is not in the model.
    """
    import mujoco

    place, data = mujoco_places(robot, model, names), mujoco.MjData(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model.opt.gravity[:] = robot.model.gravity.linear
    if not drives:
        model.dof_damping[:] = model.dof_armature[:] = 0.0
    torque = []
    for q, v, a in zip(states.q, states.v, states.a, strict=True):
        data.qpos[:], data.qvel[:] = place.mujoco_state(robot, q, v)
        data.qacc[:] = place.mujoco_acceleration(robot, q, v, a)
        mujoco.mj_inverse(model, data)
        force = data.qfrc_inverse[place.v].copy()
        if robot.floating:
            force[:3] = pin.Quaternion(q[3:7]).matrix().T @ force[:3]
        torque.append(force)
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
class WrittenModel(Stated):
    """A model file with identified inertials, and the proof that simulators read it so.

    Attributes:
        path: the file.
        changed: links (or bodies) whose inertial was changed.
        notes: what a user of the file should know, one sentence each.
        pinocchio_error: largest difference between inverse dynamics of the file read by pinocchio and the
            identified parameters' regression, relative to the largest torque; None where not checked.
        mujoco_error: the same for the file read by MuJoCo.
    """

    path: Path = field(metadata=HIDDEN)
    changed: tuple[str, ...]
    notes: tuple[str, ...]
    pinocchio_error: float | None
    mujoco_error: float | None

    @property
    @stated
    def file(self) -> str:
        """Its name."""
        return self.path.name


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
