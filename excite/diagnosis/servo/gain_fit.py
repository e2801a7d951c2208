"""Gains of one form of servo, fitted together with what they drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.effects.bodies import level_axes
from excite.diagnosis.servo.servo import Servo, Signals
from excite.logs.log import Log
from excite.logs.signals.butterworth import lowpass
from excite.regressor.kernels import inverse_dynamics, joint_torque_regressor
from excite.robot.robot import Robot

_ROWS_HZ = 25.0
_WIDTH = 6e-3
# A priori deviation of a body's mass from nominal, and of a joint's equation, relative to its torque.
_MASS, EQUATION = 0.15, 0.03
# Rows that count as one: residuals are correlated.
CORRELATED = 10.0
_ROUNDS = 5
# Stretches of a record that are left out of the gains' fit in turn.
STRETCHES = 10
# A row in which a joint turns, by the share of its dry friction that speaks there; what holds one that sticks is
# anything up to all of it. Of a Feetech servo whose 12 bits show it at rest in 53 of 655 rows a gain of 940 N·m/rad
# came of all rows, and 180 of those in which it turns. Fewer rows than this share tell nothing more.
_TURNING, _ENOUGH = 0.9, 0.25


@dataclass(frozen=True, eq=False)
class Rows:
    """What gains are fitted to.

    Attributes:
        signals: filtered, ``(n, n_joints)`` by name.
        bodies: columns of the inertial parameters ``(n, n_joints, p)``, each in units of its deviation a priori.
        unit: these, ``(p,)``.
        aside: torques of gravity of 1 m/s² along two level axes, ``(n, n_joints, 2)``.
    """

    signals: dict[str, Array]
    bodies: Array
    unit: Array
    aside: Array

    def without(self, left_out: NDArray[np.intp]) -> Rows:
        """All rows but some."""
        signals = {name: np.delete(values, left_out, axis=0) for name, values in self.signals.items()}
        bodies, aside = (np.delete(values, left_out, axis=0) for values in (self.bodies, self.aside))
        return Rows(signals, bodies, self.unit, aside)


@dataclass(frozen=True, eq=False)
class Tried:
    """One form of the servo, fitted.

    Attributes:
        servo: the servo; a gain that is not to be had is not positive.
        loss: ``(n_joints,)`` logarithm of what is left of each joint's position error; where no gain is had, of what
            friction, rotor inertia and a constant of any size leave.
    """

    servo: Servo
    loss: Array

    @property
    def sound(self) -> NDArray[np.bool_]:
        """Joints with a gain."""
        return np.asarray((self.servo.kp > 0.0) & np.isfinite(self.servo.kp))


def gain_rows(robot: Robot, log: Log, trials: list[tuple[Signals, Array]], cut_hz: float) -> Rows:
    """Rows that gains are fitted to.

    Args:
        robot: the nominal model.
        log: the log.
        trials: signals, and what a gain is of: position errors or currents ``(n, n_joints)``.
        cut_hz: cut-off of the low-pass on all of them [Hz].
    """
    rate = log.header.rate_hz
    edge = round(0.3 * rate)
    take = slice(edge, -edge, max(1, round(rate / _ROWS_HZ)))
    index = [robot.joint_index(name) for name in log.header.joints]
    stacked: dict[str, list[Array]] = {}
    bodies, aside = [], []
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
            stacked.setdefault(name, []).append(lowpass(values, rate, min(cut_hz, 0.2 * rate))[take])
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
        aside.append(_aside(robot, motion[0])[:, index])
    mass = np.maximum(phi.reshape(-1, 10)[:, 0], 0.02)
    unit = _MASS * (mass[:, None] * 0.15 ** np.array([0] + [1] * 3 + [2] * 6)).ravel()
    signals = {k: np.concatenate(v) for k, v in stacked.items()}
    return Rows(signals, np.concatenate(bodies) * unit, unit, np.concatenate(aside))


def _aside(robot: Robot, q: Array) -> Array:
    """Torques that level gravity of 1 m/s² along two axes asks for, ``(n, nv, 2)``."""
    model, still = robot.model.copy(), np.zeros((len(q), robot.model.nv))
    columns = []
    for axis in level_axes(robot.model.gravity.linear)[:2]:
        model.gravity.linear = axis
        columns.append(inverse_dynamics(model, q, still, still))
    return np.stack(columns, axis=2)


def fitted_servo(rows: Rows, kp: Array, kd: Array, kind: str, follows: bool) -> Tried:
    """Gains where they are not known, in turn with the inertial parameters.

    Residuals are compared as position errors, torques over kp: what friction the model has not is then an error of
    the position, and a smaller scale of all torques, gains and friction together gains nothing.
    """
    x = rows.signals
    turning = turning_rows(x["sign"])
    rate = (x["vc"] if follows else 0.0) - x["v"]
    before = x["nominal"] - (x[kind] if kind != "none" else 0.0)
    delta, found = np.zeros(rows.bodies.shape[2]), (kp, kd)
    rest, sound = before.std(axis=0), np.zeros(len(kp), dtype=np.bool_)
    for _ in range(_ROUNDS):
        need = before + rows.bodies @ delta
        found = _gains(x, need, rate, kp, kd, follows, turning)
        sound = found[0] > 0.0
        if not sound.any():
            break
        asked = found[0] * x["e"] + found[1] * rate - before
        delta, rest = _bodies(rows, x, asked, sound, turning)
    bare = [e - b @ _least_squares(b, e) for e, b in ((x["e"][:, j], beside(x, j)) for j in range(len(kp)))]
    left = np.where(sound, rest / found[0], np.std(bare, axis=1))
    loss = np.log(np.maximum(left, 1e-15))
    return Tried(Servo(*found, kind, follows), loss)


def spread_of_gains(rows: Rows, kp: Array, kd: Array, fitted: Servo) -> dict[str, Array]:
    """Standard deviations of gains by a jackknife over stretches of the record (Miller 1974), ``(n_joints,)`` each.

    Args:
        rows: that the gains were fitted to.
        kp: gains that are known, NaN where they are not.
        kd: alike.
        fitted: the servo of all rows, whose form is taken.
    """
    stretches = np.array_split(np.arange(len(rows.bodies)), STRETCHES)
    made = []
    for left_out in stretches:
        part = rows.without(left_out)
        servo = fitted_servo(part, kp, kd, fitted.feedforward, fitted.follows_velocity).servo
        made.append((servo.kp, servo.kd))
    off = np.array(made) - np.mean(made, axis=0)
    spread = np.sqrt((STRETCHES - 1) / STRETCHES * (off**2).sum(axis=0))
    return {"kp": spread[0], "kd": spread[1]}


def turning_rows(sign: Array) -> NDArray[np.bool_]:
    """Rows in which each joint turns, ``(n, n_joints)``; all of one that hardly does."""
    turning = np.abs(sign) > _TURNING
    return turning | (turning.mean(axis=0) < _ENOUGH)


def beside(x: dict[str, Array], j: int) -> Array:
    """Friction, rotor inertia and a constant of a joint, ``(n, 4)``."""
    ones = np.ones(len(x["v"]))
    return np.column_stack([x["sign"][:, j], x["v"][:, j], x["a"][:, j], ones])


def _gains(
    x: dict[str, Array],
    need: Array,
    rate: Array,
    kp: Array,
    kd: Array,
    follows: bool,
    turning: NDArray[np.bool_],
) -> tuple[Array, Array]:
    """Gains given the torque that the bodies need: ``e = (need − kd·rate + friction)/kp``.

    Damping of the velocity itself and viscous friction are one; it is a servo's that has no other damping.
    """
    kp, kd = kp.copy(), kd.copy()
    for j in range(len(kp)):
        here = turning[:, j]
        e, drive, needs, rates = x["e"][here, j], beside(x, j)[here], need[here, j], rate[here, j]
        if not follows and np.isnan(kd[j]):
            drive = drive[:, [0, 2, 3]]
        if not np.isnan(kp[j]):
            if np.isnan(kd[j]):
                columns = np.column_stack([rates, drive])
                kd[j] = max(float(_least_squares(columns, needs - kp[j] * e)[0]), 0.0)
            continue
        if np.isnan(kd[j]):
            found = _least_squares(np.column_stack([needs, -rates, drive]), e)
            ratio = max(float(found[1]), 0.0)
        else:
            found = _least_squares(np.column_stack([needs - kd[j] * rates, drive]), e)
            ratio = None
        kp[j] = 1.0 / found[0] if found[0] != 0.0 else np.inf
        kd[j] = kd[j] if ratio is None else ratio * kp[j]
    return kp, kd


def _bodies(
    rows: Rows, x: dict[str, Array], asked: Array, sound: NDArray[np.bool_], turning: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Change of the inertial parameters that the asked torques of sound joints speak for, and what is left of them.

    What is left, ``(n_joints,)``, is the deviation in the rows in which each joint turns.
    """
    size = rows.bodies.shape[2]
    gram, right = np.eye(size), np.zeros(size)
    parts = []
    for j in range(asked.shape[1]):
        here = turning[:, j]
        q = np.linalg.qr(beside(x, j)[here])[0]
        body, torque = rows.bodies[here, j], asked[here, j]
        body, torque = body - q @ (q.T @ body), torque - q @ (q.T @ torque)
        parts.append((body, torque))
        if sound[j]:
            scale = np.sqrt(CORRELATED) * EQUATION * max(float(x["nominal"][:, j].std()), 1e-9)
            gram += body.T @ body / scale**2
            right += body.T @ torque / scale**2
    delta = np.asarray(np.linalg.solve(gram, right), dtype=np.float64)
    return delta, np.array([(torque - body @ delta).std() for body, torque in parts])


def _least_squares(columns: Array, target: Array) -> Array:
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
    return np.linalg.lstsq(columns / size, target, rcond=1e-10)[0] / size
