"""MuJoCo's state of a run, and what acts in a step of several of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from excite.arrays import Array

if TYPE_CHECKING:
    import mujoco


class Run:
    """State of a run of a model, and MuJoCo's own arrays in it, which to ask for takes as long as a step.

    Attributes:
        data: the state.
        qpos: ``(nq,)`` positions in it.
        qvel: ``(nv,)`` velocities.
        ctrl: ``(nu,)`` what the motors are told.
        applied: ``(nv,)`` torques that are applied [N·m].
    """

    def __init__(self, model: mujoco.MjModel):
        """Make the state of a run of a model."""
        import mujoco

        self.data = mujoco.MjData(model)
        self.qpos, self.qvel, self.ctrl = self.data.qpos, self.data.qvel, self.data.ctrl
        self.applied = self.data.qfrc_applied
        self._forces = (self.data.qfrc_actuator, self.data.qfrc_passive, self.data.qfrc_constraint)
        self._armature, self._acceleration = model.dof_armature, self.data.qacc

    def carried(self) -> Array:
        """Torques that the gears carry, ``(nv,)``: what the last step's motors gave less friction and rotors [N·m]."""
        motor, passive, constraint = self._forces
        return motor + passive + constraint + self.applied - self._armature * self._acceleration


def motion(runs: Sequence[Run], positions: Array, velocities: Array) -> tuple[Array, Array]:
    """Positions [rad] and velocities [rad/s] of joints in all runs, ``(n_runs, n_joints)`` each.

    Args:
        runs: the runs.
        positions: ``(n_joints,)`` places of the joints' positions in the state.
        velocities: of their velocities.
    """
    q, v = np.array([run.qpos for run in runs]), np.array([run.qvel for run in runs])
    return q[:, positions], v[:, velocities]


class Acting(NamedTuple):
    """What acts in a step of several runs, each ``(n_runs, nv)``.

    Attributes:
        friction: levels of dry friction [N·m].
        damping: [N·m·s/rad].
        applied: torques beside the motors' [N·m].
    """

    friction: Array
    damping: Array
    applied: Array
