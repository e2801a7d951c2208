"""What is odd about a log's numbers before any model is fitted to them, and the likely cause."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from excite.arrays import Array
from excite.finding import Finding, listed
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import lowpass, settling_samples
from excite.robot.robot import Robot

_DEGREE = 180.0 / np.pi
# Positions may pass a limit by this share of the range (bent limits, calibration) before anything is said.
_BEYOND = 0.1
_TORQUE_BEYOND = 2.0
_SHORTEST_S = 5.0
_FEWEST_PER_PARAMETER = 2.0
# A channel tracks a command when what is left is this share of the command's own deviation.
_TRACKS = 0.5
# Factor by which another assignment of channels has to be better.
_BETTER = 3.0
_RATE_OFF = 1.5


def implausible(log: Log, robot: Robot) -> tuple[Finding, ...]:
    """Findings on units, order of joints, clocks, dead channels and length, likely causes named.

    Args:
        log: the log.
        robot: its robot; limits and joints are compared with.
    """
    trials = log.trials
    return (
        *_clock(log),
        *_units(log, robot),
        *_constant(log),
        *_order(log, "q_cmd", "commanded positions"),
        *_order(log, "tau_cmd", "commanded torques"),
        *_velocities(log),
        *_amount(trials, robot),
        *_torque_size(log, robot),
    )


def _clock(log: Log) -> list[Finding]:
    found = []
    late = sum(trial.cleaning.reordered_rows for trial in log.trials)
    if late:
        found.append(
            Finding("time_goes_back", f"{late} time stamps go back; rows were put in order", {"rows": late})
        )
    rates = [1.0 / float(np.median(np.diff(trial.time))) for trial in log.trials]
    factor = float(np.median(rates)) / log.header.rate_hz
    if not 1.0 / _RATE_OFF < factor < _RATE_OFF:
        units = {1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}
        near = [name for scale, name in units.items() if 0.5 < factor / scale < 2.0]
        cause = f"time looks like {near[0]}" if near else "time or rate_hz is wrong"
        text = (
            f"time stamps run at {np.median(rates):.4g} Hz, log.yaml says {log.header.rate_hz:g} Hz: {cause}"
        )
        found.append(Finding("rate", text, {"factor": factor}))
    return found


def _units(log: Log, robot: Robot) -> list[Finding]:
    """Joints beyond their limits that would be inside if the numbers were degrees."""
    columns = [robot.joint_index(name) for name in log.header.joints]
    lower, upper = robot.limits.position_lower[columns], robot.limits.position_upper[columns]
    speed = robot.limits.velocity[columns]
    margin = _BEYOND * (upper - lower)
    low = np.min([trial.q.min(axis=0) for trial in log.trials], axis=0)
    high = np.max([trial.q.max(axis=0) for trial in log.trials], axis=0)
    fast = np.max([_speed(trial) for trial in log.trials], axis=0)
    outside = (low < lower - margin) | (high > upper + margin)
    inside_as_degrees = (low / _DEGREE >= lower - margin) & (high / _DEGREE <= upper + margin)
    too_fast = fast > 3.0 * speed
    # A full turn's excess is an encoder that counts on, not a unit; degrees exceed limits manifold.
    manifold = np.maximum(np.abs(low), np.abs(high)) > 3.0 * np.maximum(np.abs(lower), np.abs(upper))
    degrees = inside_as_degrees & (manifold | (outside & too_fast))
    joints = np.array(log.header.joints)
    found = []
    if degrees.any():
        names = tuple(joints[degrees])
        text = (
            f"positions of {listed(names)} reach {np.abs([low, high]).max(axis=0)[degrees].max():.4g}, "
            "far beyond their limits or speeds in radians: they look like degrees; convert them"
        )
        figures = {"largest": float(np.abs([low, high]).max(axis=0)[degrees].max())}
        found.append(Finding("degrees", text, figures, names))
    beyond = outside & ~degrees
    if beyond.any():
        names = tuple(joints[beyond])
        excess = np.maximum(lower - low, high - upper)[beyond]
        text = (
            f"positions of {listed(names)} lie up to {excess.max():.3g} rad outside the limits: wrong order "
            "of joints, sign or zero, or a counter of turns"
        )
        found.append(Finding("beyond_limits", text, {"excess_rad": float(excess.max())}, names))
    return found


def _speed(trial: Trial) -> Array:
    """Fastest motion of each joint that noise and single steps do not make, ``(n_joints,)``."""
    rate = 1.0 / float(np.median(np.diff(trial.time)))
    cutoff = min(10.0, 0.2 * rate)
    if trial.n_samples <= settling_samples(rate, cutoff):
        return np.zeros(trial.q.shape[1])
    return np.abs(np.gradient(lowpass(trial.q, rate, cutoff), axis=0) * rate).max(axis=0)


def _constant(log: Log) -> list[Finding]:
    """Channels that never change over the whole log."""
    dead = []
    for attribute, prefix in (("tau", "tau"), ("current", "i"), ("q", "q")):
        values = [getattr(trial, attribute) for trial in log.trials]
        if any(value is None for value in values):
            continue
        still = np.all([np.ptp(value, axis=0) == 0.0 for value in values], axis=0)
        dead += [
            f"{prefix}.{name}"
            for name, flag in zip(log.header.joints, still, strict=True)
            if flag and not (name in log.header.no_torque and prefix != "q")
        ]
    for sensor in log.header.sensors:
        readings = [trial.wrenches[sensor.name] for trial in log.trials if sensor.name in trial.wrenches]
        if readings and all(np.ptp(reading) == 0.0 for reading in readings):
            dead.append(f"wrench.{sensor.name}")
    if not dead:
        return []
    text = (
        f"{listed(dead)} never change: a dead channel, or a joint that was locked; its parameters say nothing"
    )
    return [Finding("constant", text, {"channels": len(dead)}, tuple(dead))]


def _order(log: Log, attribute: str, what: str) -> list[Finding]:
    """Measured channels that follow another joint's command, or their own with the sign turned or scaled."""
    measured = "q" if attribute == "q_cmd" else "tau"
    pairs = [
        (getattr(trial, measured), getattr(trial, attribute))
        for trial in log.trials
        if getattr(trial, attribute) is not None and getattr(trial, measured) is not None
    ]
    if not pairs:
        return []
    y, x = np.concatenate([pair[0] for pair in pairs]), np.concatenate([pair[1] for pair in pairs])
    deviation = x.std(axis=0)
    moving = (deviation > 1e-6 * max(float(deviation.max()), 1e-12)) & (y.std(axis=0) > 0.0)
    if moving.sum() < 1:
        return []
    names = np.array(log.header.joints)[moving]
    y, x = y[:, moving] - y[:, moving].mean(axis=0), x[:, moving] - x[:, moving].mean(axis=0)
    miss = np.array([[np.sqrt(np.mean((yi - xj) ** 2)) for xj in x.T] for yi in y.T]) / x.std(axis=0)
    own = np.diag(miss)
    rows, order = linear_sum_assignment(np.minimum(miss, 10.0))
    moved = (rows != order) & (miss[rows, order] < np.minimum(_TRACKS, own / _BETTER))
    if moved.any():
        text = (
            f"{_MEASURED[measured]} of {listed(tuple(names[moved]))} follow the {what} of "
            f"{listed(tuple(names[order[moved]]))}: the joints stand in another order in one of them"
        )
        figures = {"own_miss": float(own[moved].max()), "other_miss": float(miss[rows, order][moved].max())}
        return [Finding("order", text, figures, tuple(names[moved]))]
    return _sign_and_scale(y, x, own, names, measured, what)


_MEASURED = {"q": "positions", "tau": "torques"}


def _sign_and_scale(y: Array, x: Array, own: Array, names: Array, measured: str, what: str) -> list[Finding]:
    slope = (y * x).sum(axis=0) / (x**2).sum(axis=0)
    left = (y - slope * x).std(axis=0) / np.maximum(y.std(axis=0), 1e-300)
    follows = (left < _TRACKS) & (own > _TRACKS)
    found = []
    for kind, chosen, cause in (
        ("sign", follows & (slope < 0.0), "the sign of one of them is turned"),
        (
            "degrees",
            follows & ((np.abs(slope * _DEGREE - 1.0) < 0.3) | (np.abs(slope / _DEGREE - 1.0) < 0.3)),
            "one is in degrees, the other in radians",
        ),
    ):
        if chosen.any():
            joints = tuple(names[chosen])
            text = (
                f"{_MEASURED[measured]} of {listed(joints)} are {slope[chosen][0]:.3g} times "
                f"the {what}: {cause}"
            )
            found.append(Finding(kind, text, {"slope": float(slope[chosen][0])}, joints))
    return found


def _velocities(log: Log) -> list[Finding]:
    """Logged velocities against differences of the positions."""
    parts = []
    for trial in log.trials:
        rate = 1.0 / float(np.median(np.diff(trial.time)))
        cutoff = min(5.0, 0.2 * rate)
        if trial.v is None or trial.n_samples <= 4 * settling_samples(rate, cutoff):
            continue
        slope = np.gradient(trial.q, trial.time, axis=0)
        parts.append([lowpass(value, rate, cutoff) for value in (slope, trial.v)])
    if not parts:
        return []
    x, v = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    power = (x**2).sum(axis=0)
    seen = power > 1e-6 * max(float(power.max()), 1e-300)
    ratio = np.where(seen, (x * v).sum(axis=0) / np.where(seen, power, 1.0), 1.0)
    odd = seen & ~((ratio > 0.5) & (ratio < 2.0))
    if not odd.any():
        return []
    names = tuple(np.array(log.header.joints)[odd])
    worst = float(ratio[odd][0])
    cause = "its sign is turned" if -2.0 < worst < -0.5 else "another joint's, or another unit"
    text = f"logged velocities of {listed(names)} are {worst:.3g} times the slope of the positions: {cause}"
    return [Finding("velocity", text, {"ratio": worst}, names)]


def _amount(trials: tuple[Trial, ...], robot: Robot) -> list[Finding]:
    chosen = [trial for trial in trials if trial.role == "identification"]
    if not chosen:
        return []
    seconds = sum(float(trial.time[-1] - trial.time[0]) for trial in chosen)
    channels = 6 if robot.floating else chosen[0].q.shape[1]
    numbers = channels * sum(trial.n_samples for trial in chosen)
    parameters = 10 * len(robot.segments)
    if seconds >= _SHORTEST_S and numbers >= _FEWEST_PER_PARAMETER * parameters:
        return []
    text = (
        f"{seconds:.1f} s and {numbers} numbers for {parameters} parameters: too few rows; record longer "
        "motions"
    )
    return [Finding("too_few_rows", text, {"seconds": seconds, "numbers": float(numbers)})]


def _torque_size(log: Log, robot: Robot) -> list[Finding]:
    limit = robot.limits.torque[[robot.joint_index(name) for name in log.header.joints]]
    parts = [np.abs(trial.tau).max(axis=0) for trial in log.trials if trial.tau is not None]
    if not parts:
        return []
    share = np.max(parts, axis=0) / limit
    over = np.isfinite(share) & (share > _TORQUE_BEYOND)
    if not over.any():
        return []
    names = tuple(np.array(log.header.joints)[over])
    text = (
        f"torques of {listed(names)} reach {share[over].max():.3g} times their limit: "
        "another unit (N·mm, currents), or the gear counted twice"
    )
    return [Finding("torque_size", text, {"share_of_limit": float(share[over].max())}, names)]
