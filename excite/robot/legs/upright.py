"""How stiff legs have to be for a robot to stand on them with nothing but servos of its joints."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.joint_values import per_joint
from excite.robot.robot import Robot

# How many times stiffer than what topples the robot a leg's joint should be: what leans by one part leans by a
# twentieth more. Of 10 leg swings of a 67 kg humanoid (H1_2) 5, 7 and 8 stand in simulation with 5, 9 and 19 at the
# ankles; of 10 of a G1 with 15 % of its mass on its back 0, 2, 7, 7 and 8 stand with 2, 4, 9, 18 and 37.
UPRIGHT = 20.0
_SOFT = 0.5 * UPRIGHT


def toppling_stiffness(robot: Robot, ends: Iterable[int], mass: float) -> dict[int, float]:
    """What topples a robot that stands on a leg: its weight times the distance of its centre of mass from a joint.

    Args:
        robot: the robot, as it stands in ``robot.rest``.
        ends: the joints at the ends of its legs, of ``robot.model``.
        mass: of the robot [kg]; what of it no segment has is at the base's origin, where that is fixed.

    Returns:
        By the index of each joint of the legs [N·m/rad].
    """
    data = robot.model.createData()
    centre = pin.centerOfMass(robot.model, data, robot.rest)
    if not robot.floating:
        centre = centre * (robot.mass / mass)
    weight = mass * float(np.linalg.norm(robot.description.gravity))
    found = {}
    for end in ends:
        joint = end
        while joint > int(robot.floating):
            found[joint] = weight * float(np.linalg.norm(centre - data.oMi[joint].translation))
            joint = int(robot.model.parents[joint])
    return found


def too_soft_to_stand(robot: Robot) -> str | None:
    """What is to be said of the softest joint of a leg on a sole, where it is too soft to stand on; else None."""
    missing: Array = np.full(robot.n_joints, np.nan)
    stiffness = per_joint(robot.description.controller.kp, robot.joint_names, missing)
    topples = toppling_stiffness(robot, (foot.joint for foot in robot.feet if foot.flat), robot.mass)
    names = {joint: robot.model.names[joint] for joint in topples}
    has = {joint: float(stiffness[robot.joint_index(name)]) for joint, name in names.items()}
    known = [joint for joint in topples if np.isfinite(has[joint])]
    softest = min(known, key=lambda joint: has[joint] / topples[joint], default=None)
    if softest is None or has[softest] >= _SOFT * topples[softest]:
        return None
    return (
        f"{names[softest]} has {has[softest]:.3g} N·m/rad (controller.kp) where {topples[softest]:.3g} topple the "
        f"robot: without feedback of balance it needs some {UPRIGHT:g} times those"
    )
