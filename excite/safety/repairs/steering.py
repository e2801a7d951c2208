"""Which coordinates of the trunk the legs can steer while all feet stay where they are."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.motion.generators.bodyparts import leg_joints, pelvis_joint
from excite.robot.robot import Robot

# In the order in which they are wanted: without the first two nothing balances, without the third no knee works.
_WANTED = ("x", "y", "height")
_TURNS = ("roll", "pitch", "yaw")
# Singular values of contacts and projections of coordinates, of the largest there, below which there is no freedom:
# rounding leaves 1e-12, the weakest that moves anything (legs of five joints, knees bent by 0.7 rad) is 1e-2.
_NOTHING = 1e-6


def steered(robot: Robot) -> frozenset[str]:
    """Which of ``x, y`` (centre of mass), ``height, roll, pitch, yaw`` (pelvis) can be prescribed at rest.

    Feet of legs with six joints, or points on legs of three, leave all six; legs with fewer joints leave fewer, of
    which the centre of mass comes first, then the height, then the turns that are freest.
    """
    model, data = robot.model, robot.model.createData()
    pin.computeJointJacobians(model, data, robot.rest)
    com = pin.jacobianCenterOfMass(model, data, robot.rest)
    legs = sorted({robot.n_base_v + i for foot in robot.feet for i in leg_joints(robot, foot)})
    moving = [*range(robot.n_base_v), *legs]
    contacts = np.vstack([_contact(robot, data, k)[:, moving] for k in range(len(robot.feet))])
    _, values, directions = np.linalg.svd(contacts)
    free = directions[int(np.sum(values > _NOTHING * values[0])) :]
    pelvis = pin.getJointJacobian(model, data, pelvis_joint(robot), pin.LOCAL_WORLD_ALIGNED)
    rows = dict(zip((*_WANTED, *_TURNS), (com[0], com[1], *pelvis[2:]), strict=True))
    rows = {name: row[moving] / np.linalg.norm(row[moving]) for name, row in rows.items()}
    chosen: list[str] = []
    left = [*_WANTED, *_TURNS]
    while left and len(free):
        turn = max(left, key=lambda name: float(np.linalg.norm(free @ rows[name])))
        name = left[0] if left[0] in _WANTED else turn
        left.remove(name)
        along = free @ rows[name]
        if np.linalg.norm(along) > _NOTHING:
            chosen.append(name)
            free = np.linalg.svd(along[None])[2][1:] @ free
    return frozenset(chosen)


def _contact(robot: Robot, data: pin.Data, number: int) -> Array:
    """What a foot holds: six rows of a flat one about its middle, three of any other, ``(6 or 3, nv)``."""
    foot = robot.feet[number]
    pose = data.oMi[foot.joint]
    jacobian = pin.getJointJacobian(robot.model, data, foot.joint, pin.LOCAL_WORLD_ALIGNED)
    lever = pose.rotation @ np.mean(foot.sole, axis=0)
    linear = jacobian[:3] - pin.skew(lever) @ jacobian[3:]
    return np.vstack([linear, jacobian[3:]]) if foot.flat else np.asarray(linear)
