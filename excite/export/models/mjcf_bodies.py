"""Bodies of a MuJoCo model that a robot's segments consist of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError
from excite.export.models.bodies import Member, moved_pseudo
from excite.export.models.mujoco_places import MujocoNames, mujoco_places
from excite.export.models.verification import random_states
from excite.identification.inertia import pseudo_inertia_matrices
from excite.robot.robot import Robot

if TYPE_CHECKING:
    import mujoco

# How far apart frames of one body may lie in the file and in the robot from one posture to another [m, rad].
_SAME_FRAME = 1e-4


@dataclass(frozen=True, eq=False)
class _Pose:
    """Poses of all bodies of both models in one state: world pose of MuJoCo's, of the robot's joints."""

    bodies: list[pin.SE3]
    joints: list[pin.SE3]


def segment_bodies(
    robot: Robot, model: mujoco.MjModel, names: MujocoNames, translation: Mapping[str, str]
) -> list[list[Member]]:
    """Bodies of each segment with their places, the one that carries its joint first.

    Raises:
        InputError: bodies do not move as the robot's segments do.
    """
    import mujoco

    place = mujoco_places(robot, model, names)
    own = {int(model.dof_bodyid[v]): joint for v, joint in _last_dofs(robot, place.v)}
    carrier = [0] * model.nbody
    for body in range(1, model.nbody):
        carrier[body] = own.get(body, carrier[int(model.body_parentid[body])])
    states = random_states(robot, robot.nominal_parameters)
    data = mujoco.MjData(model)
    members: list[list[Member]] = [[] for _ in robot.segments]
    poses = []
    for q, v, a in list(zip(states.q, states.v, states.a, strict=True))[:3]:
        place.pose(robot, data, q, v, a)
        mujoco.mj_kinematics(model, data)
        kinematics = robot.model.createData()
        pin.forwardKinematics(robot.model, kinematics, q)
        bodies = [pin.SE3(m.reshape(3, 3), p.copy()) for m, p in zip(data.xmat, data.xpos, strict=True)]
        poses.append(_Pose(bodies, [pin.SE3(pose) for pose in kinematics.oMi]))
    base = _base_placement(robot, model, poses[0], translation)
    for body in range(1, model.nbody):
        if carrier[body] == 0:
            continue
        inside = [(base * pose.joints[carrier[body]]).actInv(pose.bodies[body]) for pose in poses]
        # A body without a name is still named in notes and errors.
        name = model.body(body).name or f"body number {body}"
        apart = max(float(np.linalg.norm(pin.log6(inside[0].actInv(other)).vector)) for other in inside)
        if apart > _SAME_FRAME:
            raise InputError(
                f"body {name!r} does not move with joint {robot.model.names[carrier[body]]!r}",
                source="MuJoCo model",
                remedy="give a model of the same robot, or map the names of its joints",
            )
        entry = Member(name, inside[0], _compiled_parameters(model, body))
        members[carrier[body] - 1].insert(0 if body in own else len(members), entry)
    for segment, inside_segment in enumerate(members):
        if not inside_segment and robot.nominal_parameters[10 * segment]:
            raise InputError(
                f"no body moves with link {robot.segments[segment].link!r}", source="MuJoCo model"
            )
    return members


def _last_dofs(robot: Robot, v: Array) -> list[tuple[int, int]]:
    """Place in MuJoCo's velocities, and index in the robot's model, of every joint's last coordinate."""
    joints = list(robot.model.joints)[1:]
    return [(int(v[joint.idx_v + joint.nv - 1]), index) for index, joint in enumerate(joints, start=1)]


def _base_placement(
    robot: Robot, model: mujoco.MjModel, pose: _Pose, translation: Mapping[str, str]
) -> pin.SE3:
    """Where the template puts the URDF's root, from a body of the root link's name; else at the origin."""
    import mujoco

    if robot.floating:
        return pin.SE3.Identity()
    root = next((f.name for f in robot.model.frames if f.type == pin.FrameType.BODY), "")
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, translation.get(root, root))
    return pose.bodies[body] if body > 0 else pin.SE3.Identity()


def _compiled_parameters(model: mujoco.MjModel, body: int) -> Array | None:
    """Ten parameters of a compiled body about its own frame; None without mass."""
    if model.body_mass[body] == 0.0:
        return None
    w, x, y, z = model.body_iquat[body]
    turn = pin.Quaternion(w, x, y, z).matrix()
    moments = turn @ np.diag(model.body_inertia[body]) @ turn.T
    inertia = pin.Inertia(float(model.body_mass[body]), model.body_ipos[body].copy(), moments)
    return np.asarray(inertia.toDynamicParameters())


def segment_difference(members: list[Member], total: Array) -> float:
    """How far bodies together are from a segment's parameters, relative to the pseudo-inertia."""
    target = pseudo_inertia_matrices(total)[0]
    for member in members:
        if member.parameters is not None:
            target = target - moved_pseudo(pseudo_inertia_matrices(member.parameters)[0], member.placement)
    scale = float(np.abs(pseudo_inertia_matrices(total)).max())
    return float(np.abs(target).max()) / scale if scale else 0.0
