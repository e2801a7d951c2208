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


def eased(robot: Robot, placements: Sequence[pin.SE3], end: int, corners: Array, load: float) -> Array:
    """From the middle of a sole to the nearest point at which a load strains the ankle by :data:`EASY` at most.

    Seen from above, a load W at a point p asks ``(ẑ × a)·(p − o) W`` of a joint about the axis a through o.

    Args:
        robot: whose leg it is.
        placements: pinocchio's of its joints, the ground level (``data.oMi``).
        end: joint that carries the sole.
        corners: of the sole, ``(n, 3)`` [m], in the same frame.
        load: that it carries [N].

    Returns:
        ``(2,)`` [m]: zero of ankles that are strong enough, of joints that others' motors drive, and of what is no leg.
    """
    shift, middle = np.zeros(2), corners.mean(axis=0)
    if robot.mechanism is not None:
        return shift
    for joint in _beyond_knee(robot, placements, end, middle):
        place = placements[joint]
        axis = place.rotation @ robot.model.joints[joint].createData().S[3:].ravel()
        lever = np.array([-axis[1], axis[0]])
        level = float(np.linalg.norm(lever))
        if level == 0.0:  # it turns the sole and carries none of the load
            continue
        along = lever / level
        torque = float(robot.limits.torque[robot.joint_index(robot.model.names[joint])])
        reach = EASY * TORQUE_SHARE * torque / (load * level)
        ahead = float((middle[:2] - place.translation[:2]) @ along)
        shift += (np.clip(ahead, -reach, reach) - ahead) * along
    return shift


def before_knee(parts: Array) -> int:
    """Which part of a leg is the thigh, of parts from joint to joint to foot ``(n, 3)``: of two longest in a row the
    first."""
    sizes = np.linalg.norm(parts, axis=1)
    return int(np.argmax(sizes[:-1] + sizes[1:]))


def _beyond_knee(robot: Robot, placements: Sequence[pin.SE3], end: int, foot: Array) -> list[int]:
    """The joints between a leg's knee and its foot."""
    chain: list[int] = []
    joint = end
    while joint > int(robot.floating):
        chain.insert(0, joint)
        joint = int(robot.model.parents[joint])
    parts = np.diff([*(placements[j].translation for j in chain), foot], axis=0)
    return chain[before_knee(parts) + 2 :] if len(parts) > 1 else []
