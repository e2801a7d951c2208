"""Which joints of a MuJoCo model its motors drive, with what largest torque, and within what commands."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

from excite.robot.urdf.limits import symmetric

if TYPE_CHECKING:
    import mujoco


def torque_limits(model: mujoco.MjModel) -> dict[int, float]:
    """Largest torque of each joint: its own force range, or its motor's where that is less, the same either way."""
    import mujoco

    limits: dict[int, float] = {}
    for joint in range(model.njnt):
        if model.jnt_actfrclimited[joint]:
            limits[joint] = symmetric(*model.jnt_actfrcrange[joint])
    for actuator in range(model.nu):
        joint = int(model.actuator_trnid[actuator, 0])
        on_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
        if not on_joint:
            continue
        gear = abs(float(model.actuator_gear[actuator, 0]))
        plain = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
        if model.actuator_forcelimited[actuator]:
            most = gear * symmetric(*model.actuator_forcerange[actuator])
        elif plain and model.actuator_ctrllimited[actuator]:
            gain = abs(float(model.actuator_gainprm[actuator, 0]))
            most = gear * gain * symmetric(*model.actuator_ctrlrange[actuator])
        else:
            continue
        limits[joint] = min(most, limits.get(joint, math.inf))
    return limits


def narrow_to_commands(model: mujoco.MjModel) -> list[int]:
    """Narrow joints' ranges to what their position servos may be told, and name those that this changed.

    A servo of gear one whose force is ``kp (ctrl - q)`` is told a position, and MuJoCo keeps that in ``ctrlrange``.
    """
    import mujoco

    changed = []
    for actuator in range(model.nu):
        joint = int(model.actuator_trnid[actuator, 0])
        gain, bias = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator]
        servo = (
            model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
            and model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE
            and gain > 0.0
            and np.isclose(bias[1], -gain)
            and model.actuator_gear[actuator, 0] == 1.0
            and model.actuator_ctrllimited[actuator]
        )
        if not servo:
            continue
        low, high = model.actuator_ctrlrange[actuator]
        if model.jnt_limited[joint]:
            stated = model.jnt_range[joint]
            low, high = max(low, stated[0]), min(high, stated[1])
            if low >= high or (low == stated[0] and high == stated[1]):
                continue
        model.jnt_limited[joint], model.jnt_range[joint] = 1, (low, high)
        changed.append(joint)
    return changed


def idle_balls(model: mujoco.MjModel) -> set[int]:
    """Ball joints that no motor turns, such as a caster's; none of a model without motors, which does not tell."""
    import mujoco

    on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    on_joint |= model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINTINPARENT
    driven = {int(joint) for joint in model.actuator_trnid[on_joint, 0]}
    balls = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_BALL)
    return {int(joint) for joint in balls if int(joint) not in driven} if driven else set()


def idle_joints(model: mujoco.MjModel, bodies: Collection[int], known: Collection[int]) -> set[int]:
    """Hinges and slides of ``bodies`` that no motor drives, such as an acrobot's shoulder: no command moves them.

    None of a model without motors, which does not tell, or with motors that act on sites or bodies, which may move any.

    Args:
        model: the model.
        bodies: the robot's bodies.
        known: joints that a motor drives, or that an equality ties to others or to a value.
    """
    import mujoco

    on = mujoco.mjtTrn
    told = np.isin(model.actuator_trntype, [on.mjTRN_JOINT, on.mjTRN_JOINTINPARENT, on.mjTRN_TENDON])
    if not model.nu or not told.all():
        return set()
    one = np.isin(model.jnt_type, [mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE])
    return {int(joint) for joint in np.flatnonzero(one) if model.jnt_bodyid[joint] in bodies} - set(known)
