"""The nominal weight added to torques that a driver has taken it off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.doctor.examine import Chart
from excite.doctor.mistakes.weight import Weight
from excite.finding import Finding
from excite.logs.log import Trial
from excite.logs.robot import robot_in_log
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot
from excite.rows.kinematics import in_configurations


def with_weight(robot: Robot, chart: Chart, gravity: tuple[float, float, float]) -> Chart:
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

    def weighed(trial: Trial) -> Trial:
        if trial.tau is None:
            return trial
        q = in_configurations(mechanics, header.joints, trial.q)
        still = np.zeros((len(q), mechanics.model.nv))
        weight = inverse_dynamics(mechanics.model, q, still, still)[:, columns]
        return replace(trial, tau=trial.tau + weight)

    def said(found: Finding) -> Finding:
        if found.kind != Weight.name:
            return found
        return replace(found, remedy="the nominal weight was added to the torques; log them as measured")

    log = replace(chart.log, header=header, trials=tuple(weighed(trial) for trial in chart.log.trials))
    return replace(chart, log=log, findings=tuple(said(found) for found in chart.findings))
