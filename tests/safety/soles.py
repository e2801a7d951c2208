"""How far soles move from where they rest."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.robot import Robot


def foot_displacements(robot: Robot, q: Array) -> dict[str, Array]:
    """Largest distance of each sole's corners from where they rest, by foot name, ``(n,)`` [m]."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.rest)
    rest = {foot.name: np.array([data.oMi[foot.joint].act(c) for c in foot.sole]) for foot in robot.feet}
    moved = {foot.name: np.empty(len(q)) for foot in robot.feet}
    for i, row in enumerate(q):
        pin.forwardKinematics(robot.model, data, row)
        for foot in robot.feet:
            corners = np.array([data.oMi[foot.joint].act(c) for c in foot.sole])
            moved[foot.name][i] = np.linalg.norm(corners - rest[foot.name], axis=1).max()
    return moved
