"""How much later than the positions a log's torques are: their correlation with the best model, lag by lag."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import qr

from excite.arrays import Array
from excite.identification.problem import advance_torques, build_problem
from excite.logs.log import Log
from excite.logs.robot import robot_in_log
from excite.regressor.base_parameters import base_parameters
from excite.robot.robot import Robot
from excite.rows.base_rows import BaseRows
from excite.rows.joint_rows import JointRows, drive_terms
from excite.rows.kinematics import trial_kinematics
from excite.rows.settings import ProblemSettings


@dataclass(frozen=True, eq=False)
class Lag:
    """How much later one group of channels was logged than the other.

    Attributes:
        lag_s: positive where the measured one is late [s].
        std_s: its standard deviation, for correlated residuals [s].
    """

    lag_s: float
    std_s: float

    def summary(self) -> str:
        """One line."""
        return (
            f"torques {1e3 * abs(self.lag_s):.2f} ± {1e3 * self.std_s:.2f} ms "
            f"{'later' if self.lag_s >= 0.0 else 'earlier'} than kinematics"
        )


@dataclass(frozen=True, eq=False)
class Shifted:
    """Two groups of channels against each other at one lag.

    Attributes:
        correlation: of both.
        residual: what is left, ``(n, …)``, rows in order of time.
        slope: its change with the lag, per second and of either sign, ``(n, …)``.
    """

    correlation: float
    residual: Array
    slope: Array


def find_peak(correlation: Callable[[int], Shifted], reach: int, rate_hz: float) -> Lag:
    """The lag at which ``correlation`` is greatest.

    Args:
        correlation: of both groups for a lag in samples.
        reach: largest lag [samples].
        rate_hz: samples per second.
    """
    shifts = np.arange(-reach, reach + 1)
    values = np.array([correlation(int(shift)).correlation for shift in shifts])
    best = int(np.argmax(values))
    offset = 0.0
    if 0 < best < len(shifts) - 1:
        left, middle, right = values[best - 1 : best + 2]
        bend = left - 2.0 * middle + right
        offset = 0.5 * float(left - right) / float(bend) if bend < 0.0 else 0.0
    found = correlation(int(shifts[best]))
    return Lag(float(shifts[best] + offset) / rate_hz, _lag_deviation(found.residual, found.slope))


def _lag_deviation(residual: Array, slope: Array) -> float:
    """Sandwich: variance of ``Σ slope·residual``, neighbours in time correlated, over ``(Σ slope²)²``."""
    n = len(residual)
    score = (residual * slope).reshape(n, -1).sum(axis=1)
    information = float((slope**2).sum())
    if information == 0.0:
        return float("inf")
    spectrum = np.abs(np.fft.rfft(score, 2 * n)) ** 2
    covariances = np.fft.irfft(spectrum)[:n]
    reach = max(1, int(4.0 * (n / 100.0) ** (2.0 / 9.0)) * 4)
    taper = 1.0 - np.arange(1, reach) / reach
    variance = covariances[0] + 2.0 * float(taper @ covariances[1:reach])
    return float(np.sqrt(max(variance, covariances[0] * 1e-3)) / information)


# Largest delay that is looked for [s], and steps up to it.
_MOST_S, _STEPS = 0.06, 20


def estimate_torque_delay(robot: Robot, log: Log, settings: ProblemSettings | None = None) -> Lag:
    """Delay of torques (currents, wrenches) behind positions over all identification trials.

    The measured side is shifted against the rows of the model, and for each shift compared with what the
    best parameters make of it (the multiple correlation): parameters that have been fitted at a wrong delay,
    which friction and inertia imitate in part, do not pull the answer.

    Args:
        robot: the robot.
        log: the log.
        settings: of the problem; their own ``torque_delay_s`` is the middle of what is tried and contained in
            the result.

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
    step = _MOST_S / _STEPS
    measured = _Measurements(robot, log, settings, problem.weights)
    cache: dict[int, Array] = {0: problem.y * problem.weights}
    # A mean torque is a constant, which no shift changes: only what varies is compared.
    channels = np.eye(len(problem.channel_names))[problem.channel]
    channels = channels / np.linalg.norm(channels, axis=0)

    def shift_rows(shift: int) -> Array:
        if shift not in cache:
            cache[shift] = measured.at(shift * step)
        return cache[shift]

    def correlate_at(shift: int) -> Shifted:
        y = shift_rows(shift)
        change = (shift_rows(shift + 1) - shift_rows(shift - 1)) / (2.0 * step)
        residual, slope = (values - basis @ (basis.T @ values) for values in (y, change))
        varying = y - channels @ (channels.T @ y)
        share = float(residual @ residual) / max(float(varying @ varying), 1e-300)
        return Shifted(float(np.sqrt(max(0.0, 1.0 - share))), residual, slope)

    lag = find_peak(correlate_at, _STEPS, 1.0 / step)
    return replace(lag, lag_s=lag.lag_s + settings.torque_delay_s)


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
