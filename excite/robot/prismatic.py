"""Which joints are prismatic, and whether a robot is one chain of joints that turn."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin

from excite.robot.robot import Robot


def is_prismatic(model: pin.Model, column: int) -> bool:
    """Whether the joint of one coordinate to which a velocity belongs translates.

    Args:
        column: place of the joint's velocity among the model's.
    """
    joint = int(np.searchsorted(model.idx_vs, column, side="right")) - 1
    return bool(np.any(np.reshape(model.joints[joint].createData().S, (6, -1))[:3]))


@lru_cache(maxsize=4)
def sliding_joints(robot: Robot) -> frozenset[str]:
    """Names of a robot's joints that slide."""
    model = robot.model
    return frozenset(n for n in robot.joint_names if is_prismatic(model, model.idx_vs[model.getJointId(n)]))


def is_serial(robot: Robot) -> bool:
    """Whether every joint carries the next one and all of them turn, as in an arm; its base may be free or fixed."""
    model, first = robot.model, 2 if robot.floating else 1
    joints = range(first, model.njoints)
    carried = all(model.parents[joint] == joint - 1 for joint in joints)
    return carried and not any(is_prismatic(model, model.idx_vs[joint]) for joint in joints)
