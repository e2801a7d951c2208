"""The verb ``doctor``: what is wrong with a log, worst first, and the log without it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.doctor.examine import Chart, examine
from excite.logs.files import save_log
from excite.logs.load_with_robot import robot_and_log
from excite.logs.log import Log
from excite.logs.robot import robot_in_log
from excite.regressor.kernels import inverse_dynamics
from excite.robot.load import RobotLike
from excite.robot.robot import Robot
from excite.rows.kinematics import in_configurations


def doctor(
    log: str | Path | Log, robot: RobotLike | None = None, *, repair: str | Path | None = None
) -> Chart:
    """Look a log through for what is no physics: rows, clock, units, signs, order, zeros, channels.

    ``identify`` and ``diagnose`` do the same before they begin, and say the same.

    Args:
        log: a log folder, or a log in memory.
        robot: the nominal model, or what :func:`~excite.robot.load.load_robot` takes; by default the one that the
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
        if any(found.kind == "compensated" and found.repaired for found in chart.findings):
            chart = _with_weight(nominal, chart, loaded.header.gravity)
        save_log(chart.log, repair)
        chart = replace(chart, repaired=str(repair))
    return chart


def _with_weight(robot: Robot, chart: Chart, gravity: tuple[float, float, float]) -> Chart:
    """The chart of a log whose torques have no weight, with that of the nominal model added to them.

    What is identified then are weights by the model that the driver has, as far as the nominal one is that.

    Args:
        robot: the nominal model.
        chart: what was found, ``compensated`` among it.
        gravity: that the log states, in the world frame [m/s²].

    Returns:
        The chart as it is for a log of currents, or of motors that are coupled, whose share of a weight is not known.
    """
    header = chart.log.header.model_copy(update={"gravity": gravity})
    if header.torque == "current" or header.coupling:
        return chart
    mechanics = robot_in_log(robot, header, chart.log.folder)
    columns = [mechanics.n_base_v + mechanics.joint_index(joint) for joint in header.joints]
    trials = []
    for trial in chart.log.trials:
        q = in_configurations(mechanics, header.joints, trial.q)
        still = np.zeros((len(q), mechanics.model.nv))
        weight = inverse_dynamics(mechanics.model, q, still, still)[:, columns]
        trials.append(trial if trial.tau is None else replace(trial, tau=trial.tau + weight))
    added = "the nominal weight was added to the torques; log the measured torques"
    findings = [replace(one, remedy=added) if one.kind == "compensated" else one for one in chart.findings]
    return replace(
        chart, log=replace(chart.log, header=header, trials=tuple(trials)), findings=tuple(findings)
    )
