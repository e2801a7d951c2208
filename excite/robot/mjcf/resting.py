"""What a MuJoCo model says of rest: its keyframe, bodies that may touch, joints that tendons drive."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import mujoco

_NAMES = ("home", "stand", "standing", "init", "rest")


def rest_keyframe(model: mujoco.MjModel, joint_name: Callable[[int], str]) -> dict[str, float] | None:
    """Joint values, from their references, of the keyframe named like a rest; None without such a one."""
    import mujoco

    names = [model.key(number).name.lower() for number in range(model.nkey)]
    found = [number for name in _NAMES for number, called in enumerate(names) if called == name]
    if not found:
        return None
    q = np.asarray(model.key_qpos[found[0]])
    values = {}
    for joint in range(model.njnt):
        if model.jnt_type[joint] in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            address = int(model.jnt_qposadr[joint])
            values[joint_name(joint)] = float(q[address] - model.qpos0[address])
    return values


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
