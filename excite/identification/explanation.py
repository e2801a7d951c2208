"""Every step of the signal processing of one channel, laid open."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import qr

from excite.arrays import Array
from excite.errors import LogError
from excite.identification.preparation import Prepared, advance_torques, prepare_trial
from excite.identification.problem import build_problem
from excite.logs.log import Log, Trial
from excite.logs.robot import robot_in_log
from excite.logs.signals.butterworth import decimation_step, kept_samples, lowpass
from excite.logs.signals.clock import Lag, Shifted, find_clock, find_peak
from excite.logs.signals.resample import long_standstill, replace_outliers
from excite.logs.signals.trace import SignalStep, SignalTrace
from excite.regressor.base_parameters import base_parameters
from excite.robot.robot import Robot
from excite.rows.base_rows import BaseRows
from excite.rows.joint_rows import STANDS_FOR_S, JointRows, drive_terms
from excite.rows.kinematics import TrialKinematics, forces_on_grid, trial_kinematics
from excite.rows.settings import Filters, ProblemSettings

_SHOWN_S = 4.0
_TIME = "time [s]"
_UNITS = {"tau": "N·m", "current": "A", "q": "rad"}


def explain_signals(robot: Robot, log: Log, settings: ProblemSettings | None = None) -> SignalTrace:
    """What is done to the channel of the first identification trial that moves most.

    Args:
        robot: the robot.
        log: a log of joint torques or of contact wrenches; of the latter only what concerns positions, and
            the delay, is shown.
        settings: of the problem.

    Returns:
        The steps: clock, outliers, periods, differentiation, torques of motors and joints, delay, filter and
        decimation, standstill. Steps that the settings do not ask for show what they would find.

    Raises:
        LogError: as :func:`~excite.identification.problem.build_problem`.
    """
    settings = settings or ProblemSettings()
    trials = log.role("identification")
    if not trials:
        raise LogError("has no trial with role 'identification'", source=log.folder, field="trials")
    robot = robot_in_log(robot, log.header, log.folder)
    filters = settings.filters(floating=log.header.measures_contacts, lowpass_hz=log.header.lowpass_hz)
    trial = trials[0]
    prepared = prepare_trial(trial, settings, filters)
    k = trial_kinematics(robot, log.header, prepared.trial, settings, filters)
    moved = dict(zip(log.header.joints, np.std(trial.q, axis=0), strict=True))
    name = max(log.header.torque_joints, key=lambda joint: float(moved[joint]))
    column = log.header.joints.index(name)
    velocity = robot.n_base_v + robot.joint_index(name)
    shown = _Shown(trial, column, name, k, velocity, _window(k, velocity))
    steps = [_clock_step(shown), _outlier_step(shown, settings, prepared)]
    if prepared.n_periods is not None:
        steps.append(_period_step(shown, prepared))
    steps += _derivative_steps(shown, filters, settings)
    lag = estimate_torque_delay(robot, log, replace(settings, torque_delay_s=0.0))
    steps.append(_delay_step(lag, settings))
    if not log.header.measures_contacts:
        rows = JointRows(robot, log.header, settings, filters, drive_terms(log.header, settings))
        channel = rows.channel_names.index(name)
        torque = forces_on_grid(prepared.trial.time, rows.torque(prepared.trial), k.time)[:, channel]
        if rows.motors is not None and trial.tau is not None:
            steps.append(_coupling_step(shown, rows.torque(trial)[:, channel]))
        steps += _torque_steps(shown, torque, filters, settings)
    return SignalTrace(trial.name, name, tuple(steps))


@dataclass(frozen=True, eq=False)
class _Shown:
    """The trial, its channel, and the seconds of it that are shown."""

    trial: Trial
    column: int
    joint: str
    kinematics: TrialKinematics
    velocity: int
    span: tuple[float, float]

    def raw(self, values: Array) -> tuple[Array, Array]:
        """Samples of the trial as logged inside the span: times and values."""
        return self.part(self.trial.time, values)

    def part(self, time: Array, values: Array) -> tuple[Array, Array]:
        """Samples inside the span."""
        inside = (time >= self.span[0]) & (time <= self.span[1])
        return time[inside], values[inside]


def _window(k: TrialKinematics, velocity: int) -> tuple[float, float]:
    """The seconds in which the joint moves most."""
    speed = np.abs(np.where(k.valid, k.v[:, velocity], 0.0))
    length = min(len(speed), max(2, round(_SHOWN_S * k.rate_hz)))
    sums = np.convolve(speed, np.ones(length), mode="valid")
    start = int(np.argmax(sums))
    return float(k.time[start]), float(k.time[start + length - 1])


def _clock_step(shown: _Shown) -> SignalStep:
    trial = shown.trial
    clock = find_clock(trial.time, trial.q)
    before, after = (np.diff(time) * 1e3 for time in (trial.time, clock.time))
    return SignalStep(
        "clock",
        f"samples lie on {clock.summary()}",
        "interval between samples [ms]",
        _TIME,
        trial.time[1:],
        before,
        clock.time[1:],
        after,
    )


def _outlier_step(shown: _Shown, settings: ProblemSettings, prepared: Prepared) -> SignalStep:
    trial = shown.trial
    group = _force_group(trial)
    values = getattr(trial, group)
    repaired = replace_outliers(values, settings.outlier_sigma or 6.0)
    counts = prepared.n_outliers
    if counts is not None:
        effect = ", ".join(f"{count} in {name}" for name, count in counts.items()) + " replaced"
    else:
        effect = (
            f"{repaired.count} in {group} stand out by more than 6 deviations; left, as none were asked for"
        )
    marks = np.where(repaired.found[:, shown.column], values[:, shown.column], np.nan)
    time, own = trial.time, values[:, shown.column]
    return SignalStep(
        "outliers", effect, f"{group} [{_UNITS[group]}]", _TIME, time, own, time, marks, dots=True
    )


def _force_group(trial: Trial) -> str:
    """Channels that hold the trial's forces: torques, else currents, else none but positions."""
    return "tau" if trial.tau is not None else "current" if trial.current is not None else "q"


def _period_step(shown: _Shown, prepared: Prepared) -> SignalStep:
    trial, mean = shown.trial, prepared.trial
    group = _force_group(trial)
    unit = _UNITS[group]
    noise = 0.0 if prepared.period_std is None else float(prepared.period_std[shown.column])
    effect = (
        f"mean of {prepared.n_periods} periods (eq. 11 of Xu et al. 2020): noise {noise:.3g} → "
        f"{noise / np.sqrt(prepared.n_periods or 1):.3g} {unit}"
    )
    before, after = getattr(trial, group)[:, shown.column], getattr(mean, group)[:, shown.column]
    return SignalStep("periods", effect, f"{group} [{unit}]", _TIME, trial.time, before, mean.time, after)


def _derivative_steps(shown: _Shown, filters: Filters, settings: ProblemSettings) -> list[SignalStep]:
    trial, k = shown.trial, shown.kinematics
    position = trial.q[:, shown.column]
    raw = np.gradient(position, trial.time)
    twice = np.gradient(raw, trial.time)
    way = (
        f"in the frequency domain up to {filters.kinematics_cutoff_hz:g} Hz"
        if settings.differentiation == "fourier"
        else f"central differences after a zero-phase filter of {filters.kinematics_cutoff_hz:g} Hz"
    )
    steps = []
    for name, before, after, unit in (
        ("velocity", raw, k.v[:, shown.velocity], "rad/s"),
        ("acceleration", twice, k.a[:, shown.velocity], "rad/s²"),
    ):
        x, y = shown.raw(before)
        after_x, after_y = shown.part(k.time, after)
        noise = float(np.std(y - np.interp(x, after_x, after_y)))
        effect = f"{way}; takes {noise:.2g} {unit} off plain differences"
        steps.append(SignalStep(name, effect, f"{name} [{unit}]", _TIME, x, y, after_x, after_y))
    return steps


def _delay_step(lag: Lag, settings: ProblemSettings) -> SignalStep:
    best = int(np.argmin(np.abs(lag.tried_s - lag.lag_s)))
    applied = settings.torque_delay_s
    done = f"; {1e3 * applied:.2f} ms taken out" if applied else "; nothing was taken out"
    unexplained = np.sqrt(np.maximum(0.0, 1.0 - lag.correlations**2)) * 100.0
    at = int(np.argmin(np.abs(lag.tried_s - applied)))
    return SignalStep(
        "delay",
        lag.summary() + done,
        "unexplained [%]",
        "torques taken earlier by [ms]",
        1e3 * lag.tried_s,
        unexplained,
        1e3 * lag.tried_s[[at, best]],
        unexplained[[at, best]],
        dots=True,
    )


def _coupling_step(shown: _Shown, joint: Array) -> SignalStep:
    motor = shown.trial.tau[:, shown.column] if shown.trial.tau is not None else joint
    x, before = shown.raw(motor)
    _, after = shown.raw(joint)
    effect = f"torque of the joint from those of the motors; differs by {np.std(joint - motor):.3g} N·m"
    return SignalStep("coupling", effect, "torque [N·m]", _TIME, x, before, x, after)


def _torque_steps(
    shown: _Shown, torque: Array, filters: Filters, settings: ProblemSettings
) -> list[SignalStep]:
    k = shown.kinematics
    smooth = lowpass(torque, k.rate_hz, filters.cutoff_hz, filters.order)
    step = decimation_step(k.rate_hz, filters.rate_hz)
    kept = kept_samples(len(torque), step)
    x, before = shown.part(k.time, torque)
    after_x, after = shown.part(k.time[kept], smooth[kept])
    effect = (
        f"zero-phase Butterworth of order {filters.order} at {filters.cutoff_hz:g} Hz on torque and regressor "
        f"alike takes {np.std(torque - smooth):.2g} N·m off; every {step}. sample stays"
    )
    rest = SignalStep("filter", effect, "torque [N·m]", _TIME, x, before, after_x, after, dots=True)
    speed = k.v[:, shown.velocity]
    shortest = max(2, round(STANDS_FOR_S * k.rate_hz))
    stands = long_standstill(speed[:, None], settings.standstill_velocity, shortest)[:, 0]
    stands[: k.moving.start] = stands[k.moving.stop :] = True
    effect = f"{100.0 * stands.mean():.0f} % of the samples are standstill and left out"
    moving = np.where(stands | ~k.valid, np.nan, speed)
    return [rest, SignalStep("standstill", effect, "velocity [rad/s]", _TIME, k.time, speed, k.time, moving)]


# How much later than the positions a log's torques are: their correlation with the best model, lag by lag.

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
        self.trials = [prepare_trial(trial, settings, filters).trial for trial in trials]
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
