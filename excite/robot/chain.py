"""Whether a robot's joints are one chain, in the order in which they carry each other."""

from __future__ import annotations

from excite.robot.prismatic import is_prismatic
from excite.robot.robot import Robot


def is_serial(robot: Robot) -> bool:
    """Whether every joint carries the next one and all of them turn, as in an arm; its base may be free or fixed."""
    model, first = robot.model, 2 if robot.floating else 1
    joints = range(first, model.njoints)
    carried = all(model.parents[joint] == joint - 1 for joint in joints)
    return carried and not any(is_prismatic(model, model.idx_vs[joint]) for joint in joints)
