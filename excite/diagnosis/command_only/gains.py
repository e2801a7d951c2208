"""Gains and feedforward of a servo that the log does not state."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from excite.diagnosis.command_only.servo import FEEDFORWARDS, WORDS, Servo, Signals
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
    said = dict(log.header.controller or {})
    if said.get("mode", "position") != "position":
        raise LogError(
            f"mode {said['mode']!r} is no position servo",
            field="controller.mode",
            remedy="log tau.* or tau_cmd.* with such a controller",
        )
    joints = log.header.joints
    kp, kd = (np.array([float((said.get(g) or {}).get(j, np.nan)) for j in joints]) for g in ("kp", "kd"))
    word = str(said["feedforward"]).lower() if "feedforward" in said else ""
    kinds = (WORDS[word],) if word in WORDS else FEEDFORWARDS
    rows = _rows(robot, log, [(t, t.commanded.value - t.measured.value) for t in trials.values()])
    tried = [_fitted(rows, kp, kd, kind, follows) for kind in kinds for follows in (True, False)]
    # Damping of the velocity itself has to explain clearly more to be believed.
    found = [(t.loss + 0.02 * (not t.servo.follows_velocity), k) for k, t in enumerate(tried) if t.sound]
    if not found:
        weak = ", ".join(j for j, k in zip(joints, tried[0].servo.kp, strict=True) if not k > 0.0)
        raise LogError(
            f"gains cannot be estimated from this motion ({weak or 'all joints'})",
            field="controller",
            remedy="state controller.kp, controller.kd and controller.feedforward",
        )
    missing = [f"kp of {j}" for j, k in zip(joints, kp, strict=True) if np.isnan(k)]
    missing += [f"kd of {j}" for j, k in zip(joints, kd, strict=True) if np.isnan(k)]
    if word not in WORDS:
        missing.append("the feedforward")
    return replace(tried[min(found)[1]].servo, estimated=tuple(missing))


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
        motion = []
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
    """Gains where they are not known."""
    x, n = rows.signals, len(kp)
    kp, kd = kp.copy(), kd.copy()
    gram, right = np.eye(rows.bodies.shape[2]), np.zeros(rows.bodies.shape[2])
    own, targets, scales = [], [], []
    for j in range(n):
        rate = (x["vc"][:, j] if follows else 0.0) - x["v"][:, j]
        target = x["nominal"][:, j] - (x[kind][:, j] if kind != "none" else 0.0)
        free = [-x["sign"][:, j], -x["v"][:, j], -x["a"][:, j], np.ones_like(target)]
        for gain, column in ((kd[j], rate), (kp[j], x["e"][:, j])):
            if np.isnan(gain):
                free.insert(0, column)
            else:
                target = target - gain * column
        columns = np.column_stack(free)
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
        q = np.linalg.qr(columns)[0]
        scale = _EQUATION * max(float(x["nominal"][:, j].std()), 1e-9)
        a = -(rows.bodies[:, j] - q @ (q.T @ rows.bodies[:, j])) / scale
        gram += a.T @ a
        right += a.T @ (target - q @ (q.T @ target)) / scale
        own.append(np.column_stack(free))
        targets.append(target)
        scales.append(scale)
    delta = np.linalg.solve(gram, right)
    loss = 0.0
    for j in range(n):
        rest = targets[j] + rows.bodies[:, j] @ delta
        found = np.linalg.lstsq(own[j], rest, rcond=1e-10)[0]
        loss += float(np.log(max((rest - own[j] @ found).std(), 1e-9) / scales[j])) / n
        gains = iter(found.tolist())
        if np.isnan(kp[j]):
            kp[j] = next(gains)
        if np.isnan(kd[j]):
            kd[j] = max(next(gains), 0.0)
    return _Tried(Servo(kp, kd, kind, follows), loss + 0.5 * float(delta @ delta) / len(targets[0]))
