"""Gains and feedforward of a servo that the log does not state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.servo.currents.constant_fit import constants_beside_bodies
from excite.diagnosis.servo.gain_fit import Tried, fitted_servo, gain_rows, spread_of_gains
from excite.diagnosis.servo.levels import error_integral
from excite.diagnosis.servo.servo import Servo, Signals
from excite.diagnosis.servo.stated import stated_servo
from excite.errors import LogError
from excite.logs.log import Log
from excite.robot.robot import Robot

_FIT_HZ = 10.0
# Without a feedforward of the motion the errors are as slow as the motion, and the noise of their rates is not.
_SLOW_HZ = 4.0
# Differences of mean logarithms that decide nothing: for damping of the velocity itself, for none; kd/kp of none [s].
_DOUBT, _UNDAMPED, _DAMPED_S = 0.02, 0.1, 1e-3


def known_servo(robot: Robot, log: Log, trials: dict[str, Signals]) -> Servo:
    """The servo as stated, what is not stated estimated on the identification trials.

    Unknown gains are fitted together with inertial parameters near the nominal ones, friction, rotor inertia and
    a constant, for every form that is not stated; the form that leaves least is taken. The scale of all torques
    is the nominal masses'.

    Args:
        robot: the nominal model.
        log: the log.
        trials: signals of its identification trials by name.

    Returns:
        The servo.

    Raises:
        LogError: ``controller`` says something else than a position servo, or no gain can be had.
    """
    joints = log.header.joints
    stated = stated_servo(log.header.controller, joints)
    kp, kd = stated.kp, stated.kd
    slow = np.divide(stated.ki, kp, out=np.zeros_like(kp), where=stated.ki != 0.0)
    asked = [(t, _error(t, slow)) for t in trials.values()]
    rows = gain_rows(robot, log, asked, _FIT_HZ)
    tried = [fitted_servo(rows, kp, kd, kind, way) for kind in stated.feedforwards for way in stated.follows]
    best = _best(tried)
    if best.servo.feedforward != "inverse_dynamics" and np.isnan(np.concatenate([kp, kd])).any():
        slower = gain_rows(robot, log, asked, _SLOW_HZ)
        again = fitted_servo(slower, kp, kd, best.servo.feedforward, best.servo.follows_velocity)
        if again.sound.sum() >= best.sound.sum():
            rows, best = slower, again
    if not best.sound.all():
        weak = ", ".join(j for j, sound in zip(joints, best.sound, strict=True) if not sound)
        raise LogError(
            f"gains cannot be estimated from this motion ({weak})",
            field="controller",
            remedy="state controller.kp, controller.kd and controller.feedforward",
        )
    guessed = np.isnan(np.concatenate([kp, kd])).any()
    spread = spread_of_gains(rows, kp, kd, best.servo) if guessed else {}
    return replace(best.servo, ki=stated.ki, estimated=stated.missing, rate_hz=stated.rate_hz, spread=spread)


def _error(signals: Signals, slow: Array) -> Array:
    """Position error and ``slow`` = ki/kp [1/s] times its integral, which has no mean here."""
    error = signals.commanded.value - signals.measured.value
    wound = slow * error_integral(signals)
    return np.asarray(error + wound - wound.mean(axis=0))


def torque_constants(
    robot: Robot, log: Log, trials: dict[str, Signals], currents: dict[str, Array], known: Array
) -> Array:
    """Torque per current of every joint, ``(n_joints,)`` [N·m/A].

    Args:
        robot: the nominal model.
        log: the log.
        trials: signals of its identification trials by name.
        currents: ``(n, n_joints)`` motor currents by the same names [A].
        known: ``(n_joints,)`` constants, NaN where they are not stated; those are estimated as gains are, or, where
            the bodies are given, beside what these may lack.

    Returns:
        The constants.

    Raises:
        LogError: one cannot be had from this motion.
    """
    if not np.isnan(known).any():
        return known
    # No command is involved: the velocity's error is nothing.
    still = {k: replace(s, commanded=s.measured) for k, s in trials.items()}
    rows = gain_rows(robot, log, [(still[k], currents[k]) for k in still], _FIT_HZ)
    if "rigid_body" in log.header.modelled:
        constants = fitted_servo(rows, known, np.zeros_like(known), "none", True).servo.kp
    else:
        told = np.array([joint not in log.header.no_torque for joint in log.header.joints])
        constants = constants_beside_bodies(robot, rows, known, told)
    weak = [j for j, k in zip(log.header.joints, constants, strict=True) if not abs(k) > 1e-9]
    if weak:
        raise LogError(
            "torque constants cannot be estimated from this motion: " + ", ".join(weak),
            field="torque_constants",
            remedy="state torque_constants in log.yaml [N·m/A]",
        )
    return constants


def _best(tried: list[Tried]) -> Tried:
    """The form that leaves least."""
    return min(tried, key=lambda t: float(t.loss.mean()) + _doubt(t))


def _doubt(tried: Tried) -> float:
    """What a form has to leave less to be believed: damping of the velocity itself, and a servo without damping."""
    if not tried.servo.follows_velocity:
        return _DOUBT
    damped = tried.servo.kd > _DAMPED_S * tried.servo.kp
    return 0.0 if damped[tried.sound].sum() > 0.5 * tried.sound.sum() else _UNDAMPED
