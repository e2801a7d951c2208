"""The diagnosis of a log: where it differs from its nominal model, which effect explains it, how far it shrinks."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from excite.diagnosis.arm import diagnose_arm
from excite.diagnosis.floating.diagnose import diagnose_floating
from excite.diagnosis.result import Diagnosis
from excite.errors import InputError
from excite.logs.files import load_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from excite.robot.robot import Robot


def diagnose(
    log: str | Path | Log, robot: Robot | None = None, *, seed: int = 0, out: str | Path | None = None
) -> Diagnosis:
    """Find where a robot differs from its nominal model, which effect causes it, and how far it shrinks.

    Args:
        log: a log folder, or a log in memory.
        robot: the nominal model; by default the one that the log names.
        seed: of the bootstrap.
        out: folder for the augmented simulator and motions; none are written without it.

    Returns:
        The diagnosis (``excite.diagnosis/1``).

    Raises:
        LogError: the log is malformed or has not what a diagnosis needs.
        InputError: a diagnosis of this kind of log is not available.
    """
    loaded = log if isinstance(log, Log) else load_log(log, robot)
    robot = robot or nominal_robot(loaded)
    if loaded.header.base == "fixed" and loaded.header.torque in {"motor_side", "link_side"}:
        return diagnose_arm(robot, loaded, np.random.default_rng(seed), None if out is None else Path(out))
    if loaded.header.base != "fixed" and loaded.header.sensors:
        return diagnose_floating(loaded, robot, np.random.default_rng(seed))
    raise InputError(
        f"base {loaded.header.base} with torque {loaded.header.torque} is not diagnosed yet",
        field="torque",
        remedy="use a fixed-base log with joint torques, or a floating-base log with contact wrenches",
    )
