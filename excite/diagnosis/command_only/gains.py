"""Gains and feedforward of a servo that the log does not state."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.diagnosis.command_only.levels import error_integral
from excite.diagnosis.command_only.servo import Servo, Signals
from excite.diagnosis.command_only.stated import stated_servo
from excite.errors import LogError
from excite.logs.log import Log
from excite.logs.signals.butterworth import lowpass
from excite.regressor.kernels import joint_torque_regressor
from excite.robot.robot import Array, Robot

_FIT_HZ = 10.0
_ROWS_HZ = 25.0
_WIDTH = 6e-3
# A priori deviation of a body's mass from nominal, and of a joint's equation, relative to its torque.
_MASS, _EQUATION = 0.15, 0.03
# Rows that count as one: residuals are correlated.
_CORRELATED = 10.0
_ROUNDS = 5


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
    rows = _rows(robot, log, [(t, _error(t, slow)) for t in trials.values()])
    tried = [_fitted(rows, kp, kd, kind, way) for kind in stated.feedforwards for way in stated.follows]
    # Damping of the velocity itself has to explain clearly more to be believed.
    found = [(t.loss + 0.02 * (not t.servo.follows_velocity), k) for k, t in enumerate(tried) if t.sound]
    if not found:
        weak = ", ".join(j for j, k in zip(joints, tried[0].servo.kp, strict=True) if not k > 0.0)
        raise LogError(
            f"gains cannot be estimated from this motion ({weak or 'all joints'})",
            field="controller",
            remedy="state controller.kp, controller.kd and controller.feedforward",
        )
    return replace(tried[min(found)[1]].servo, ki=stated.ki, estimated=stated.missing)


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
        known: ``(n_joints,)`` constants, NaN where they are not stated; those are estimated as gains are.

    Returns:
        The constants.

    Raises:
        LogError: one cannot be had from this motion.
    """
    if not np.isnan(known).any():
        return known
    # No command is involved: the velocity's error is nothing.
    still = {k: replace(s, commanded=s.measured) for k, s in trials.items()}
    rows = _rows(robot, log, [(still[k], currents[k]) for k in still])
    constants = _fitted(rows, known, np.zeros_like(known), "none", True).servo.kp
    weak = [j for j, k in zip(log.header.joints, constants, strict=True) if not abs(k) > 1e-9]
    if weak:
        raise LogError(
            "torque constants cannot be estimated from this motion: " + ", ".join(weak),
            field="torque_constants",
            remedy="state torque_constants in log.yaml [N·m/A]",
        )
    return constants


@dataclass(frozen=True, eq=False)
class _Rows:
    """Filtered signals ``(n, n_joints)`` by name, and columns of the inertial parameters ``(n, n_joints, p)``."""

    signals: dict[str, Array]
    bodies: Array


@dataclass(frozen=True, eq=False)
class _Tried:
    """One form of the servo, fitted: mean logarithm of what is left of each joint's torque."""

    servo: Servo
    loss: float

    @property
    def sound(self) -> bool:
        return bool((self.servo.kp > 0.0).all() and np.isfinite(self.loss))


def _rows(robot: Robot, log: Log, trials: list[tuple[Signals, Array]]) -> _Rows:
    rate = log.header.rate_hz
    edge = round(0.3 * rate)
    take = slice(edge, -edge, max(1, round(rate / _ROWS_HZ)))
    index = [robot.joint_index(name) for name in log.header.joints]
    stacked: dict[str, list[Array]] = {}
    bodies = []
    phi = robot.nominal_parameters
    for s, asked in trials:
        made = {
            "e": asked,
            "vc": s.commanded.first,
            "v": s.measured.first,
            "a": s.measured.second,
            "sign": np.tanh(s.measured.first / _WIDTH),
            "gravity": s.gravity,
            "inverse_dynamics": s.dynamics,
            "nominal": s.nominal,
        }
        for name, values in made.items():
            stacked.setdefault(name, []).append(lowpass(values, rate, min(_FIT_HZ, 0.2 * rate))[take])
        motion: list[Array] = []
        for values in (s.measured.value, s.measured.first, s.measured.second):
            full = (
                np.tile(robot.rest, (len(values), 1))
                if not motion
                else np.zeros((len(values), robot.model.nv))
            )
            full[:, index] = values
            motion.append(full[take])
        bodies.append(joint_torque_regressor(robot.model, *motion)[:, index])
    mass = np.maximum(phi.reshape(-1, 10)[:, 0], 0.02)
    size = (mass[:, None] * 0.15 ** np.array([0] + [1] * 3 + [2] * 6)).ravel()
    return _Rows({k: np.concatenate(v) for k, v in stacked.items()}, np.concatenate(bodies) * size * _MASS)


def _fitted(rows: _Rows, kp: Array, kd: Array, kind: str, follows: bool) -> _Tried:
    """Gains where they are not known, in turn with the inertial parameters.

    Residuals are compared as position errors, torques over kp: what friction the model has not is then an error of
    the position, and a smaller scale of all torques, gains and friction together gains nothing.
    """
    x = rows.signals
    rate = (x["vc"] if follows else 0.0) - x["v"]
    before = x["nominal"] - (x[kind] if kind != "none" else 0.0)
    delta, found = np.zeros(rows.bodies.shape[2]), (kp, kd)
    rest = before
    for _ in range(_ROUNDS):
        need = before + rows.bodies @ delta
        found = _gains(x, need, rate, kp, kd)
        if not (found[0] > 0.0).all():
            return _Tried(Servo(*found, kind, follows), np.inf)
        asked = found[0] * x["e"] + found[1] * rate - before
        delta, rest = _bodies(rows, x, asked)
    loss = float(np.mean(np.log(np.maximum(rest.std(axis=0), 1e-12) / found[0])))
    return _Tried(Servo(*found, kind, follows), loss)


def _beside(x: dict[str, Array], j: int) -> Array:
    """Friction, rotor inertia and a constant of a joint, ``(n, 4)``."""
    ones = np.ones(len(x["v"]))
    return np.column_stack([x["sign"][:, j], x["v"][:, j], x["a"][:, j], ones])


def _gains(x: dict[str, Array], need: Array, rate: Array, kp: Array, kd: Array) -> tuple[Array, Array]:
    """Gains given the torque that the bodies need: ``e = (need − kd·rate + friction)/kp``."""
    kp, kd = kp.copy(), kd.copy()
    for j in range(len(kp)):
        e, beside = x["e"][:, j], _beside(x, j)
        if not np.isnan(kp[j]):
            if np.isnan(kd[j]):
                columns = np.column_stack([rate[:, j], beside])
                kd[j] = max(float(_least_squares(columns, need[:, j] - kp[j] * e)[0]), 0.0)
            continue
        if np.isnan(kd[j]):
            found = _least_squares(np.column_stack([need[:, j], -rate[:, j], beside]), e)
            ratio = max(float(found[1]), 0.0)
        else:
            found = _least_squares(np.column_stack([need[:, j] - kd[j] * rate[:, j], beside]), e)
            ratio = None
        kp[j] = 1.0 / found[0] if found[0] != 0.0 else np.inf
        kd[j] = kd[j] if ratio is None else ratio * kp[j]
    return kp, kd


def _bodies(rows: _Rows, x: dict[str, Array], asked: Array) -> tuple[Array, Array]:
    """Change of the inertial parameters that the asked torques speak for, and what is left of them."""
    size = rows.bodies.shape[2]
    gram, right = np.eye(size), np.zeros(size)
    beside = [np.linalg.qr(_beside(x, j))[0] for j in range(asked.shape[1])]
    for j, q in enumerate(beside):
        scale = np.sqrt(_CORRELATED) * _EQUATION * max(float(x["nominal"][:, j].std()), 1e-9)
        a = (rows.bodies[:, j] - q @ (q.T @ rows.bodies[:, j])) / scale
        gram += a.T @ a
        right += a.T @ (asked[:, j] - q @ (q.T @ asked[:, j])) / scale
    delta = np.asarray(np.linalg.solve(gram, right), dtype=np.float64)
    rest = asked - rows.bodies @ delta
    return delta, np.column_stack([r - q @ (q.T @ r) for r, q in zip(rest.T, beside, strict=True)])


def _least_squares(columns: Array, target: Array) -> Array:
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
    return np.linalg.lstsq(columns / size, target, rcond=1e-10)[0] / size
