"""What each constraint costs in condition numbers: from random states of a free robot to motions that may be run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.excitation.conditioning import segment_columns, segment_conditions
from excite.motion.motion import Motion
from excite.regressor.base_parameters import BaseParameters, r_factor
from excite.regressor.columns import measured_columns, regressor_rows
from excite.robot.robot import Foot, Robot

_STATES = 1500
STEPS = ("no constraint", "a foot on the ground", "… in postures of the motions")

State = tuple[Array, Array, Array]


def ladder(robot: Robot, base: BaseParameters, motions: Sequence[Motion]) -> dict[str, dict[str, float]]:
    """Condition number of each segment's sub-regressor at random states, constraint by constraint.

    Joint velocities and accelerations are normal with the root mean squares that the motions have, so that what
    differs from step to step is where joints may be, and that a foot stands still.

    Args:
        robot: a humanoid.
        base: its structural base parameters.
        motions: that may be run.

    Returns:
        By step of :data:`STEPS`, by segment.
    """
    random = np.random.default_rng(0)
    nv = robot.n_base_v
    moved = [
        np.sqrt(np.mean(np.vstack([getattr(m, kind)[:, nv:] for m in motions]) ** 2, axis=0))
        for kind in ("v", "a")
    ]
    postures = np.vstack([motion.joint_positions() for motion in motions])
    limits = robot.limits

    def joints(own: bool) -> State:
        q = (
            postures[random.integers(len(postures))]
            if own
            else random.uniform(limits.position_lower, limits.position_upper)
        )
        return q, moved[0] * random.normal(size=len(q)), moved[1] * random.normal(size=len(q))

    makers: Mapping[str, Callable[[], State]] = {
        STEPS[0]: lambda: _free(robot, joints(False), random),
        STEPS[1]: lambda: _standing(robot, joints(False), robot.feet[random.integers(len(robot.feet))]),
        STEPS[2]: lambda: _standing(robot, joints(True), robot.feet[random.integers(len(robot.feet))]),
    }
    columns = measured_columns(robot)
    own = segment_columns(robot, columns, base)
    found = {}
    for step, make in makers.items():
        states = [make() for _ in range(_STATES)]
        q, v, a = (np.array([state[i] for state in states]) for i in range(3))
        rows = regressor_rows(robot, columns, q, v, a)
        matrix = r_factor(rows.reshape(-1, rows.shape[2]))
        found[step] = {cell.segment: cell.condition for cell in segment_conditions(matrix, own)}
    return found


def _free(robot: Robot, joints: State, random: np.random.Generator) -> State:
    """The base anyhow, its twist and acceleration normal, 1 and 5 in SI units."""
    quaternion = random.normal(size=4)
    q = np.concatenate([np.zeros(3), quaternion / np.linalg.norm(quaternion), joints[0]])
    v = np.concatenate([random.normal(size=6), joints[1]])
    return q, v, np.concatenate([5.0 * random.normal(size=6), joints[2]])


def _standing(robot: Robot, joints: State, foot: Foot) -> State:
    """The base such that a foot is still and its sole level."""
    model, data = robot.model, robot.model.createData()
    q = np.concatenate([pin.SE3ToXYZQUAT(pin.SE3.Identity()), joints[0]])
    pin.forwardKinematics(model, data, q)
    q[:7] = pin.SE3ToXYZQUAT((data.oMi[foot.joint] * foot.placement).inverse())
    jacobian = np.array(pin.computeJointJacobian(model, data, q, foot.joint))
    v = np.concatenate([np.zeros(6), joints[1]])
    v[:6] = -np.linalg.solve(jacobian[:, :6], jacobian @ v)
    a = np.concatenate([np.zeros(6), joints[2]])
    pin.forwardKinematics(model, data, q, v, a)
    a[:6] = -np.linalg.solve(jacobian[:, :6], data.a[foot.joint].vector)
    return q, v, a
