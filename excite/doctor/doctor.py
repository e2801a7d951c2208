"""The verb ``doctor``: what is wrong with a log, worst first, and the log without it."""

from __future__ import annotations

from pathlib import Path

from excite.doctor.examine import Chart, examine
from excite.doctor.mistakes.weight import Weight
from excite.doctor.weight_added import with_weight
from excite.logs.brought import robot_and_log
from excite.logs.files import save_log
from excite.logs.log import Log
from excite.robot.bringing import RobotLike


def doctor(
    log: str | Path | Log, robot: RobotLike | None = None, *, repair: str | Path | None = None
) -> Chart:
    """Look a log through for what is no physics: rows, clock, units, signs, order, zeros, channels.

    ``identify`` and ``diagnose`` do the same before they begin, and say the same.

    Args:
        log: a log folder, or a log in memory.
        robot: the nominal model, or what :func:`~excite.robot.bringing.load_robot` takes; by default the one that the
            log names.
        repair: folder that the log is written to with everything repaired that could be, the nominal weight added where
            a driver has taken it off the torques; none is without it.

    Returns:
        The repaired log and the findings, worst first.

    Raises:
        LogError: the log is malformed, or ``repair`` holds something that is no log.
        RobotError: the nominal model is malformed.
    """
    nominal, loaded = robot_and_log(robot, log)
    chart = examine(nominal, loaded)
    if repair is not None:
        if any(found.kind == Weight.name and found.repaired for found in chart.findings):
            chart = with_weight(nominal, chart, loaded.header.gravity)
        save_log(chart.log, repair)
    return chart
