"""Models that were written, as readers that share nothing with the writers find them: pinocchio and MuJoCo."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import InputError
from excite.formats.documents import elements_of
from excite.regressor.base_parameters import draw_configurations
from excite.regressor.kernels import joint_torque_regressor
from excite.robot.loading import model_file
from excite.robot.robot import Robot
from excite.robot.urdf.reading import parse_urdf, urdf_model
from excite.robot.urdf.tree import settle_root
from excite.simulation.coordinates import position_to_mujoco, velocity_to_mujoco

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, eq=False)
class States:
    """Random states and the generalised forces that parameters ask for there.

    Attributes:
        q: ``(n, nq)``, v and a ``(n, nv)`` in the robot's layout.
        v: see ``q``.
        a: see ``q``.
        regressor: ``(n, nv, 10·n_segments)``, base in its own frame.
        torque: ``(n, nv)``.
    """

    q: Array
    v: Array
    a: Array
    regressor: Array
    torque: Array

    def error(self, torque: Array) -> float:
        """Largest difference from ``torque``, relative to the largest torque."""
        return float(np.abs(torque - self.torque).max() / max(float(np.abs(self.torque).max()), 1e-9))


def random_states(robot: Robot, parameters: Array) -> States:
    """States all over the joints' turn, and the torques of ``parameters`` ``(10·n_segments,)`` in them."""
    random, n = np.random.default_rng(7), 20
    q = draw_configurations(robot, random, n)
    v, a = random.normal(size=(2, n, robot.model.nv))
    regressor = joint_torque_regressor(robot.model, q, v, a)
    return States(q, v, a, regressor, regressor @ parameters)


@dataclass(frozen=True, eq=False)
class Reading:
    """A robot as it was read from files.

    Attributes:
        torques: inverse dynamics of its bodies alone, ``(n, nv)`` in the robot's layout.
        inertial: ``(10·n_segments,)`` parameters of its segments, joint frames.
        terms: of joints and servos that the files hold, ``(n_joints,)`` each in the robot's order; NaN where a joint
            has none.
    """

    torques: Array
    inertial: Array
    terms: Mapping[str, Array] = field(default_factory=dict)


def held_joints(robot: Robot) -> dict[str, float]:
    """Position of every joint of the robot's URDF that it holds still, mimic followers of held ones included."""
    held = dict(robot.description.locked_joints)
    for joint in parse_urdf(model_file(robot)).findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None and mimic.get("joint") in held and joint.get("type") != "fixed":
            follow = float(mimic.get("multiplier", "1")) * held[str(mimic.get("joint"))]
            held.setdefault(str(joint.get("name")), follow + float(mimic.get("offset", "0")))
    return held


def read_urdf_text(
    robot: Robot, text: bytes | str, states: States, terms: Mapping[str, tuple[str, str, float]] | None = None
) -> Reading:
    """A URDF text by pinocchio alone, joints that the robot holds still held.

    Args:
        states: in which its torques are asked for.
        terms: by term the element of a joint, its attribute there, and what one that is missing stands for.

    Raises:
        InputError: the file's joints are not the robot's.
    """
    root: Element = elements_of(text)
    settle_root(root)
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    read = {}
    for term, (tag, attribute, default) in (terms or {}).items():
        elements = (joints[name].find(tag) for name in robot.joint_names)
        values = [default if one is None else float(one.get(attribute, default)) for one in elements]
        read[term] = np.array(values)
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
                SubElement(element, "limit", lower="0", upper="0", effort="0", velocity="0")
    raw = urdf_model(root, Path("written model"), floating=robot.floating)
    held = {name: value for name, value in held_joints(robot).items() if raw.existJointName(name)}
    posture = pin.neutral(raw)
    for name, value in held.items():
        posture[raw.joints[raw.getJointId(name)].idx_q] = value
    model = pin.buildReducedModel(raw, [raw.getJointId(name) for name in held], posture)
    return read_pinocchio(robot, model, states, read)


def read_pinocchio(robot: Robot, model: pin.Model, states: States, terms: Mapping[str, Array]) -> Reading:
    """What a model of pinocchio holds; raises InputError where its joints are not the robot's."""
    if list(model.names) != list(robot.model.names):
        raise InputError("its joints are not the robot's", source="written model")
    model.gravity = robot.model.gravity
    data, rows = model.createData(), zip(states.q, states.v, states.a, strict=True)
    torques = np.array([pin.rnea(model, data, *row) for row in rows])
    inertial = [body.toDynamicParameters() for body in list(model.inertias)[1:]]
    return Reading(torques, np.concatenate(inertial), terms)


@dataclass(frozen=True, eq=False)
class MujocoPlaces:
    """Where a robot's coordinates stand in those of a MuJoCo model, whose order may be another.

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


def mujoco_places(robot: Robot, model: mujoco.MjModel) -> MujocoPlaces:
    """Find the robot's joints in a MuJoCo model.

    Raises:
        InputError: a joint, or the free joint of a base that floats, is not there.
    """
    import mujoco

    def joint_id(name: str) -> int:
        return int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name))

    start, rows = np.array(model.qpos0), [joint_id(name) for name in robot.joint_names]
    for name, value in held_joints(robot).items():
        if joint_id(name) >= 0:
            start[model.jnt_qposadr[joint_id(name)]] += value
    free = [] if not robot.floating else np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).tolist()
    lacking = [f"joint {name!r}" for name, row in zip(robot.joint_names, rows, strict=True) if row < 0]
    lacking += ["free joint"] * (robot.floating and not free)
    if lacking:
        remedy = "give a model of the same robot, its joints called alike"
        raise InputError(f"has no {lacking[0]} of robot {robot.name!r}", source="MuJoCo model", remedy=remedy)
    q, v = [model.jnt_qposadr[row] for row in rows], [model.jnt_dofadr[row] for row in rows]
    if free:
        base = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, robot.base_link)
        first = next((row for row in free if model.jnt_bodyid[row] == base), free[0])
        q[:0], v[:0] = (model.jnt_qposadr[first] + np.arange(7), model.jnt_dofadr[first] + np.arange(6))
        start[q[:7]] = 0.0
    return MujocoPlaces(np.array(q), np.array(v), start, int(model.nv))


def mujoco_torques(robot: Robot, model: mujoco.MjModel, states: States) -> Array:
    """``mj_inverse`` of a compiled model's bodies alone, ``(n, nv)``; its gravity, flags and joints' terms change.

    Raises:
        InputError: a joint of the robot is not in the model.
    """
    import mujoco

    place, data = mujoco_places(robot, model), mujoco.MjData(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model.opt.gravity[:] = robot.model.gravity.linear
    model.dof_damping[:] = model.dof_armature[:] = 0.0
    torque = []
    for q, v, a in zip(states.q, states.v, states.a, strict=True):
        data.qpos[:], data.qvel[:] = place.mujoco_state(robot, q, v)
        base = a.copy()
        if robot.floating:
            base[:3] += np.cross(v[3:6], v[:3])
        data.qacc[:] = 0.0
        data.qacc[place.v] = velocity_to_mujoco(q, base, floating=robot.floating)
        mujoco.mj_inverse(model, data)
        force = data.qfrc_inverse[place.v].copy()
        if robot.floating:
            force[:3] = pin.Quaternion(q[3:7]).matrix().T @ force[:3]
        torque.append(force)
    return np.array(torque)
