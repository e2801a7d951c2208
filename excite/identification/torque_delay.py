"""How much later than the positions a log's torques are: their correlation with the best model, lag by lag."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import qr

from excite.arrays import Array
from excite.identification.problem import advance_torques, build_problem
from excite.logs.log import Log
from excite.logs.robot import robot_in_log
from excite.logs.signals.clock import Lag, Shifted, find_peak
from excite.regressor.base_parameters import base_parameters
from excite.robot.robot import Robot
from excite.rows.base_rows import BaseRows
from excite.rows.joint_rows import JointRows, drive_terms
from excite.rows.kinematics import trial_kinematics
from excite.rows.settings import ProblemSettings

_STEPS = 20


def estimate_torque_delay(
    robot: Robot, log: Log, settings: ProblemSettings | None = None, *, max_delay_s: float = 0.06
) -> Lag:
    """Delay of torques (currents, wrenches) behind positions over all identification trials.

    The measured side is shifted against the rows of the model, and for each shift compared with what the
    best parameters make of it (the multiple correlation): parameters that have been fitted at a wrong delay,
    which friction and inertia imitate in part, do not pull the answer.

    Args:
        robot: the robot.
        log: the log.
        settings: of the problem; their own ``torque_delay_s`` is the middle of what is tried and contained in
            the result.
        max_delay_s: largest delay from there that is looked for [s].

    Returns:
        The delay to set as ``torque_delay_s``.

    Raises:
        LogError: as :func:`~excite.identification.problem.build_problem`.
    """
    settings = settings or ProblemSettings()
    problem = build_problem(robot, log, settings)
    rows = problem.Y * problem.weights[:, None]
    independent = base_parameters(rows, problem.parameter_names).independent
    basis = np.asarray(qr(rows[:, independent], mode="economic")[0])
    step = max_delay_s / _STEPS
    measured = _Measurements(robot, log, settings, problem.weights)
    cache: dict[int, Array] = {0: problem.y * problem.weights}
    # A mean torque is a constant, which no shift changes: only what varies is compared.
    channels = np.eye(len(problem.channel_names))[problem.channel]
    channels = channels / np.linalg.norm(channels, axis=0)

    def shifted(shift: int) -> Array:
        if shift not in cache:
            cache[shift] = measured.at(shift * step)
        return cache[shift]

    def correlation(shift: int) -> Shifted:
        y = shifted(shift)
        change = (shifted(shift + 1) - shifted(shift - 1)) / (2.0 * step)
        residual, slope = (values - basis @ (basis.T @ values) for values in (y, change))
        varying = y - channels @ (channels.T @ y)
        share = float(residual @ residual) / max(float(varying @ varying), 1e-300)
        return Shifted(float(np.sqrt(max(0.0, 1.0 - share))), residual, slope)

    lag = find_peak(correlation, _STEPS, 1.0 / step)
    return replace(
        lag, lag_s=lag.lag_s + settings.torque_delay_s, tried_s=lag.tried_s + settings.torque_delay_s
    )


class _Measurements:
    """The measured side of a problem's rows for any delay, kinematics computed once."""

    def __init__(self, robot: Robot, log: Log, settings: ProblemSettings, weights: Array):
        filters = settings.filters(floating=log.header.measures_contacts, lowpass_hz=log.header.lowpass_hz)
        robot = robot_in_log(robot, log.header, log.folder)
        self.builder: BaseRows | JointRows
        if log.header.measures_contacts:
            self.builder = BaseRows(robot, log.header, settings, filters)
        else:
            terms = drive_terms(log.header, settings)
            self.builder = JointRows(robot, log.header, settings, filters, terms)
        self.weights = weights
        trials = log.role("identification")
        self.trials = [advance_torques(trial, settings.torque_delay_s) for trial in trials]
        self.kinematics = [
            trial_kinematics(robot, log.header, trial, settings, filters) for trial in self.trials
        ]

    def at(self, delay_s: float) -> Array:
        """Weighted measurements ``(n_rows,)`` with torques ``delay_s`` earlier than the settings have them."""
        parts = []
        for trial, kinematics in zip(self.trials, self.kinematics, strict=True):
            rows = self.builder.measurement(advance_torques(trial, delay_s), kinematics)
            parts.append(rows.values[:, :, 0][rows.use])
        return np.concatenate(parts) * self.weights
