"""Which joints are prismatic."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin

from excite.robot.robot import Robot

# Which joints slide instead of turning.


def is_prismatic(model: pin.Model, column: int) -> bool:
    """Whether the joint of one coordinate to which a velocity belongs translates.

    Args:
        model: of a robot.
        column: place of the joint's velocity among the model's.
    """
    joint = int(np.searchsorted(model.idx_vs, column, side="right")) - 1
    return bool(np.any(np.reshape(model.joints[joint].createData().S, (6, -1))[:3]))


@lru_cache(maxsize=4)
def sliding_joints(robot: Robot) -> frozenset[str]:
    """Names of a robot's joints that slide."""
    model = robot.model
    return frozenset(n for n in robot.joint_names if is_prismatic(model, model.idx_vs[model.getJointId(n)]))
