"""Rotor inertias that a MuJoCo model states, which a URDF cannot."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco


def rotor_inertias(model: mujoco.MjModel, joint_name: Callable[[int], str]) -> dict[str, float]:
    """``armature`` of the hinges and slides that have one, by name [kg·m² or kg]."""
    import mujoco

    # As integers: MuJoCo's enumerations are unequal to NumPy's.
    single = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
    return {
        joint_name(joint): float(model.dof_armature[model.jnt_dofadr[joint]])
        for joint in range(model.njnt)
        if int(model.jnt_type[joint]) in single and model.dof_armature[model.jnt_dofadr[joint]] > 0.0
    }
