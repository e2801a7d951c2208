"""Where a robot's coordinates stand in a MuJoCo model whose names may be others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from excite.arrays import Array
from excite.errors import InputError
from excite.robot.robot import Robot
from excite.simulation.coordinates import position_to_mujoco, velocity_to_mujoco

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, eq=False)
class MujocoNames:
    """Names in a MuJoCo model.

    Attributes:
        joints: of the robot's actuated joints.
        base: body of the free joint.
        held: position of the joints that the robot does not have.
    """

    joints: tuple[str, ...]
    base: str
    held: Mapping[str, float]


def robot_names(robot: Robot, names: Mapping[str, str], held: Mapping[str, float]) -> MujocoNames:
    """Names of a robot's joints and base, ``names`` translating them where the file has its own."""
    return MujocoNames(
        tuple(names.get(name, name) for name in robot.joint_names),
        names.get(robot.base_link, robot.base_link),
        held,
    )


@dataclass(frozen=True, eq=False)
class MujocoPlaces:
    """Where the robot's coordinates stand in a MuJoCo model's, ``q`` ``(nq,)`` and ``v`` ``(nv,)``.

    ``start`` ``(model.nq,)`` is added to them: zero of the robot's joints, position of all others.
    """

    q: Array
    v: Array
    start: Array

    def pose(self, robot: Robot, data: mujoco.MjData, q: Array, v: Array, a: Array) -> None:
        """Bring MuJoCo's state to the robot's ``q``, ``v``, ``a`` (base twist in the base frame)."""
        data.qpos[:], data.qvel[:], data.qacc[:] = self.start, 0.0, 0.0
        data.qpos[self.q] += position_to_mujoco(q, floating=robot.floating)
        data.qvel[self.v] = velocity_to_mujoco(q, v, floating=robot.floating)
        base = a.copy()
        if robot.floating:
            base[:3] += np.cross(v[3:6], v[:3])
        data.qacc[self.v] = velocity_to_mujoco(q, base, floating=robot.floating)


def mujoco_places(robot: Robot, model: mujoco.MjModel, names: MujocoNames) -> MujocoPlaces:
    """Find the robot's joints in a model; raises InputError where one is not there."""
    import mujoco

    q: list[int] = []
    v: list[int] = []
    start = model.qpos0.copy()
    for name, value in names.held.items():
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        if index >= 0:
            start[model.jnt_qposadr[index]] += value
    if robot.floating:
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, names.base)
        first = int(model.body_jntadr[body]) if body >= 0 else -1
        if first < 0 or model.jnt_type[first] != mujoco.mjtJoint.mjJNT_FREE:
            raise InputError(
                f"no body {names.base!r} with a free joint",
                source="MuJoCo model",
                remedy="give the base a <freejoint/>, or map its name",
            )
        q += range(model.jnt_qposadr[first], model.jnt_qposadr[first] + 7)
        v += range(model.jnt_dofadr[first], model.jnt_dofadr[first] + 6)
        start[q] = 0.0
    for name in names.joints:
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        if index < 0:
            raise InputError(
                f"no joint {name!r}", source="MuJoCo model", remedy="map the robot's names to the file's"
            )
        q.append(model.jnt_qposadr[index])
        v.append(model.jnt_dofadr[index])
    return MujocoPlaces(np.array(q), np.array(v), start)
