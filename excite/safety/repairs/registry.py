"""All repairs, in the order in which they run: cheap rejections first. A new one is one file and its line here."""

from __future__ import annotations

from excite.robot.robot import Robot
from excite.safety.repairs.collisions import CollisionProbe
from excite.safety.repairs.draft import Repair
from excite.safety.repairs.retiming import Retiming
from excite.safety.repairs.sampling import Sampling
from excite.safety.repairs.shares import Shares
from excite.safety.repairs.time_scaling import TimeScaling
from excite.safety.repairs.waypoints import Waypoints
from excite.safety.repairs.whole_body import WholeBody

REPAIRS: dict[str, type[Repair]] = {
    repair.name: repair
    for repair in (
        Waypoints,
        WholeBody,
        Retiming,
        TimeScaling,
        Sampling,
    )
}


def make_repairs(robot: Robot, shares: Shares | None = None) -> list[Repair]:
    """One of each, ready for a robot.

    Args:
        robot: the robot.
        shares: how much of each limit to use; the default leaves the verdict a margin.
    """
    probe, shares = CollisionProbe(robot), shares or Shares()
    return [repair(robot, probe, shares) for repair in REPAIRS.values()]
