"""A log and its robot, as they are or as they are named."""

from __future__ import annotations

from pathlib import Path

from excite.logs.files import load_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot, robot_for_log
from excite.robot.bringing import RobotLike, as_robot
from excite.robot.robot import Robot


def robot_and_log(robot: RobotLike | None, log: str | Path | Log) -> tuple[Robot, Log]:
    """The nominal robot and the log.

    Args:
        robot: the robot, its bundled name, a ``robot.yaml`` or a model; None for the one that the log names.
        log: a log folder, or a log in memory.

    Raises:
        LogError: the log is malformed, or does not fit the robot.
        RobotError: the model is malformed.
        UnknownNameError: no such robot.
        InputError: the robot is none, and no name of one.
    """
    folder = log.folder if isinstance(log, Log) else log
    if isinstance(robot, str | Path) and folder is not None:
        robot = robot_for_log(robot, folder)
    found = None if robot is None else as_robot(robot)
    loaded = log if isinstance(log, Log) else load_log(log, found)
    return found or nominal_robot(loaded), loaded
