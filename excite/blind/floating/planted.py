"""Legs that differ from their model, and soles that stay where they stand all the same."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from excite.arrays import Array, Moved
from excite.motion.generators.bodyparts import leg_joints
from excite.motion.motion import Motion
from excite.robot.robot import Robot

_MOST_STEPS, _CLOSE = 20, 1e-10


def plant_feet(robot: Robot, model: pin.Model, motion: Motion) -> Moved:
    """The motion with the legs' joints such that base and soles go where they were planned to go."""
    nominal = robot.model
    moved = {
        j
        for j in range(2, model.njoints)
        if not model.jointPlacements[j].isApprox(nominal.jointPlacements[j])
    }
    q, v, a = motion.q.copy(), motion.v.copy(), motion.a.copy()
    for foot in robot.feet:
        if not moved & {int(j) for j in nominal.supports[foot.joint]}:
            continue
        chain = [index + 2 for index in leg_joints(robot, foot)]
        shift = np.array(_leg_shift(nominal, model, foot.joint, chain, motion.q))
        columns = [model.idx_vs[j] for j in chain]
        rates = _finite_differences(motion.time, shift)
        for k, column in enumerate(columns):
            q[:, column + 1] += shift[:, k]
            v[:, column] += rates[0][:, k]
            a[:, column] += rates[1][:, k]
    return Moved(q, v, a)


def _leg_shift(nominal: pin.Model, model: pin.Model, foot: int, chain: list[int], plan: Array) -> list[Array]:
    """By sample, what the joints of a chain turn beyond the plan so that the foot is where it was planned."""
    wanted, data = nominal.createData(), model.createData()
    columns = [model.idx_vs[j] for j in chain]
    shifts, shift = [], np.zeros(len(chain))
    for row in plan:
        pin.forwardKinematics(nominal, wanted, row)
        q = row.copy()
        for _ in range(_MOST_STEPS):
            q[[column + 1 for column in columns]] = row[[column + 1 for column in columns]] + shift
            jacobian = pin.computeJointJacobian(model, data, q, foot)[:, columns]
            pin.forwardKinematics(model, data, q)
            error = pin.log6(data.oMi[foot].actInv(wanted.oMi[foot])).vector
            if error @ error < _CLOSE**2:
                break
            # A little damping where the leg cannot reach.
            normal = jacobian.T @ jacobian + 1e-8 * np.eye(len(chain))
            shift = shift + np.linalg.solve(normal, jacobian.T @ error)
        shifts.append(shift.copy())
    return shifts


def _finite_differences(time: Array, values: Array) -> tuple[Array, Array]:
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(time, values, k=5, axis=0)
    return spline.derivative(1)(time), spline.derivative(2)(time)
