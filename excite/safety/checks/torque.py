"""Torque limits of the joints, with the ground's forces in the legs."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.robot.joint_values import per_joint
from excite.safety.checks.base import Check, CheckResult, first_violations, nearest_joints
from excite.safety.checks.sweep import Sweep
from excite.safety.force_distribution import RESIDUAL_TOLERANCE


class JointTorqueCheck(Check):
    """Drive torques stay below their limits: ``τ = RNEA(q, v, a) − Σ Jᵀ f`` plus the drives' own friction
    and inertia.

    Evaluated at about 200 Hz (:data:`~excite.safety.checks.sweep.TORQUE_RATE_HZ`). In single support the
    foot's wrench, and so the torque, is unique; in double support it depends on how the feet share the load,
    and the smallest forces are taken (:func:`~excite.safety.force_distribution.distribute_wrench`). Where the
    contacts cannot carry the motion there is no torque to speak of and the margin is None.
    """

    name: ClassVar[str] = "joint_torque"
    margin_field: ClassVar[str | None] = "joint_torque_nm"

    def judge(self, sweep: Sweep) -> CheckResult:
        robot, samples = sweep.robot, sweep.torque_samples
        tau = drive_torques(sweep)
        limits = robot.limits.torque
        bad = ~(np.abs(tau) <= limits) & np.isfinite(tau)
        time = sweep.fine.time[samples]
        violations = first_violations("joint_torque", robot.joint_names, time, np.abs(tau), limits, bad)
        computed = np.isfinite(tau).all() and not (
            bool(robot.feet)
            and robot.floating
            and (sweep.contact_forces[0].residual > RESIDUAL_TOLERANCE).any()
        )
        if not computed:
            return CheckResult(violations=violations)
        room = limits - np.abs(tau)
        nearest = nearest_joints("joint_torque", robot, room.min(axis=0))
        return CheckResult(float(room.min()), violations, nearest=nearest)


def drive_torques(sweep: Sweep) -> Array:
    """Torques that the drives must deliver at ``sweep.torque_samples``, ``(m, n_joints)`` [N·m or N]."""
    robot, samples = sweep.robot, sweep.torque_samples
    tau = sweep.dynamics.tau[samples].copy()
    for i, foot in enumerate(robot.feet):
        forces = sweep.contact_forces[i].forces
        corners = sweep.sole_corners[i][samples]
        force, moment = forces.sum(axis=1), np.cross(corners, forces).sum(axis=1)
        # The joints between the base and the foot, of one coordinate each.
        legs = list(robot.model.supports[foot.joint])[2:]
        carried = np.einsum("njk,nk->nj", sweep.dynamics.screws[:, legs], np.hstack([force, moment]))
        tau[:, [robot.model.idx_vs[joint] for joint in legs]] -= carried
    tau = robot.on_motors(sweep.fine.q[samples], tau)
    v, a = sweep.fine.joint_velocities()[samples], sweep.fine.joint_accelerations()[samples]
    drives, nothing = robot.description.drives, np.zeros(robot.n_joints)
    viscous, coulomb, armature = (
        per_joint(block, robot.joint_names, nothing)
        for block in (drives.viscous, drives.coulomb, drives.armature)
    )
    return np.asarray(tau[:, robot.n_base_v :] + viscous * v + coulomb * np.sign(v) + armature * a)
