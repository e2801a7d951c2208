"""Where on its sole a foot holds a load without asking too much of its ankle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.holding import TORQUE_SHARE
from excite.robot.robot import Robot

# Share of what motions may use of an ankle's torque that a load at rest asks of it at most: beside it the zero-moment
# point moves. Of six leg swings each of an AzureLoong and an EngineAI SA01 all are safe with 0.5, none with 0.8 or over
# the middle of the sole; G1, HRP-2 and Talos stand over that with less.
EASY = 0.5


class Ankle:
    """The joints between a leg's knee and its foot.

    Args:
        robot: whose leg it is.
        end: joint that carries the foot.
        middle: of the foot, in that joint's frame ``(3,)`` [m].
    """

    def __init__(self, robot: Robot, end: int, middle: Array) -> None:
        # Joints that others' motors drive have no torque of their own.
        self._joints = _beyond_knee(robot, end, middle) if robot.mechanism is None else []
        self._axes = [robot.model.joints[joint].createData().S[3:].ravel() for joint in self._joints]
        self._torques = [
            float(robot.limits.torque[robot.joint_index(robot.model.names[joint])]) for joint in self._joints
        ]

    def eased(self, placements: Sequence[pin.SE3], point: Array, load: float) -> Array:
        """The way from a point to the nearest at which a load strains no joint of the ankle by more than :data:`EASY`.

        Seen from above, a load W at a point p asks ``(ẑ × a)·(p − o) W`` of a joint about the axis a through o.

        Args:
            placements: pinocchio's of the robot's joints, the ground level (``data.oMi``).
            point: seen from above, in the same frame ``(2,)`` [m].
            load: that the foot carries [N].

        Returns:
            ``(2,)`` [m]: zero of ankles that are strong enough, and of what is no leg.
        """
        shift = np.zeros(2)
        for joint, own, torque in zip(self._joints, self._axes, self._torques, strict=True):
            place = placements[joint]
            axis = place.rotation @ own
            lever = np.array([-axis[1], axis[0]])
            level = float(np.linalg.norm(lever))
            if level == 0.0:  # it turns the sole and carries none of the load
                continue
            along = lever / level
            reach = EASY * TORQUE_SHARE * torque / (load * level)
            ahead = float((point - place.translation[:2]) @ along)
            shift += (np.clip(ahead, -reach, reach) - ahead) * along
        return shift


def before_knee(sizes: Array) -> int:
    """Which part of a leg is the thigh, of the sizes of its parts from joint to joint to foot: of the two longest in a
    row the first."""
    return int(np.argmax(sizes[:-1] + sizes[1:]))


def _beyond_knee(robot: Robot, end: int, middle: Array) -> list[int]:
    chain: list[int] = []
    joint = end
    while joint > int(robot.floating):
        chain.insert(0, joint)
        joint = int(robot.model.parents[joint])
    parts = [*(robot.model.jointPlacements[j].translation for j in chain[1:]), middle]
    return chain[before_knee(np.linalg.norm(parts, axis=1)) + 2 :] if len(parts) > 1 else []
