"""What a MuJoCo model says of rest: its keyframe, bodies that may touch, joints that tendons drive."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from excite.robot.mjcf.torques import torque_limits

if TYPE_CHECKING:
    import mujoco

# A joint that neither its motor nor the weight of all it carries, a metre away from a hinge, moves faster than this
# on the earth cannot be made to move [m/s or rad/s, m/s²]. Dampings of joints that move end at 1e3; some of gymnasium's
# Fetch are locked by 1e7 and 1e11. What a wrist carries may weigh nothing in a model: a hand that is yet to be added.
_SLOWEST, _GRAVITY = 1e-3, 9.81

_NAMES = ("home", "stand", "standing", "init", "rest")


def rest_keyframe(model: mujoco.MjModel, joint_name: Callable[[int], str]) -> dict[str, float] | None:
    """Joint values, from their references, of the keyframe named like a rest; None without such a one."""
    names = [model.key(number).name.lower() for number in range(model.nkey)]
    found = [number for name in _NAMES for number, called in enumerate(names) if called == name]
    if not found:
        return None
    q = np.asarray(model.key_qpos[found[0]])
    values = {}
    for joint in _single_joints(model):
        address = int(model.jnt_qposadr[joint])
        values[joint_name(joint)] = float(q[address] - model.qpos0[address])
    return values


def damped_joints(model: mujoco.MjModel) -> set[int]:
    """Hinges and slides whose damping lets nothing move them."""
    force = _GRAVITY * model.body_subtreemass[model.jnt_bodyid]
    for joint, torque in torque_limits(model).items():
        force[joint] = max(force[joint], torque)
    damping = model.dof_damping[model.jnt_dofadr]
    return {joint for joint in _single_joints(model) if damping[joint] * _SLOWEST > force[joint]}


def _single_joints(model: mujoco.MjModel) -> list[int]:
    """Hinges and slides."""
    import mujoco

    # As integers: MuJoCo's enumerations are unequal to NumPy's, though not the other way round.
    kinds = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
    return [joint for joint in range(model.njnt) if int(model.jnt_type[joint]) in kinds]


def excluded_pairs(
    model: mujoco.MjModel, bodies: tuple[int, ...], link_name: Callable[[int], str]
) -> tuple[tuple[str, str], ...]:
    """Pairs of links whose contacts the model excludes."""
    pairs = []
    for signature in model.exclude_signature:
        first, second = int(signature) >> 16, int(signature) & 0xFFFF
        if first in bodies and second in bodies:
            pairs.append((link_name(first), link_name(second)))
    return tuple(pairs)


def tendon_groups(model: mujoco.MjModel) -> list[set[int]]:
    """Joints that an actuator drives through a tendon, together with others, actuator by actuator."""
    import mujoco

    groups = []
    for actuator in range(model.nu):
        if model.actuator_trntype[actuator] != mujoco.mjtTrn.mjTRN_TENDON:
            continue
        tendon = int(model.actuator_trnid[actuator, 0])
        first = int(model.tendon_adr[tendon])
        joints = model.wrap_objid[first : first + int(model.tendon_num[tendon])]
        groups.append({int(joint) for joint in joints})
    return groups
