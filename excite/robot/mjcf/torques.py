"""Which joints of a MuJoCo model its motors drive, and with what largest torque."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import mujoco


def torque_limits(model: mujoco.MjModel) -> dict[int, float]:
    """Largest torque of each joint: its own force range, else its motor's."""
    import mujoco

    limits: dict[int, float] = {}
    for joint in range(model.njnt):
        if model.jnt_actfrclimited[joint]:
            limits[joint] = float(np.abs(model.jnt_actfrcrange[joint]).max())
    for actuator in range(model.nu):
        joint = int(model.actuator_trnid[actuator, 0])
        on_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
        if not on_joint or joint in limits:
            continue
        gear = abs(float(model.actuator_gear[actuator, 0]))
        plain = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
        if model.actuator_forcelimited[actuator]:
            limits[joint] = gear * float(np.abs(model.actuator_forcerange[actuator]).max())
        elif plain and model.actuator_ctrllimited[actuator]:
            gain = abs(float(model.actuator_gainprm[actuator, 0]))
            limits[joint] = gear * gain * float(np.abs(model.actuator_ctrlrange[actuator]).max())
    return limits


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
