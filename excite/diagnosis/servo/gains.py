"""Gains and feedforward of a servo, and torque constants of motors, as far as a log does not state them."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.answer.answer import Absorbed, estimated_gains
from excite.diagnosis.effects.bodies import level_axes
from excite.diagnosis.servo.servo import FEEDFORWARDS, Servo, Signals
from excite.errors import LogError
from excite.logs.log import Log
from excite.logs.signals.butterworth import lowpass
from excite.regressor.kernels import inverse_dynamics, joint_torque_regressor
from excite.robot.robot import Robot

_FIT_HZ = 10.0
# Without a feedforward of the motion the errors are as slow as the motion, and the noise of their rates is not.
_SLOW_HZ = 4.0
# Differences of mean logarithms that decide nothing: for damping of the velocity itself, for none; kd/kp of none [s].
_DOUBT, _UNDAMPED, _DAMPED_S = 0.02, 0.1, 1e-3
_ROWS_HZ = 25.0
_WIDTH = 6e-3
# A priori deviation of a body's mass from nominal, and of a joint's equation, relative to its torque.
_MASS, _EQUATION = 0.15, 0.03
# Rows that count as one: residuals are correlated.
_CORRELATED = 10.0
_ROUNDS = 5
# Stretches of a record that are left out of the gains' fit in turn.
_STRETCHES = 10
# A row in which a joint turns, by the share of its dry friction that speaks there; what holds one that sticks is
# anything up to all of it. Of a Feetech servo whose 12 bits show it at rest in 53 of 655 rows a gain of 940 N·m/rad
# came of all rows, and 180 of those in which it turns. Fewer rows than this share tell nothing more.
_TURNING, _ENOUGH = 0.9, 0.25
# Directions of what a model lacks that the motion does not show, relative; Gauss and Newton's steps.
_BLIND, _STEPS = 1e-5, 12

# What ``controller`` of a log says of its servo.

_REMEDY = "log tau.* or tau_cmd.* with such a controller"
# Words of ``feedforward`` and the three forms that they mean.
_WORDS = {
    **dict.fromkeys(("none", "off"), "none"),
    **dict.fromkeys(("gravity", "gravity_compensation"), "gravity"),
    **dict.fromkeys(
        (
            "inverse_dynamics computed_torque rigid_body rigid_body_dynamics rnea nominal nominal_model model full"
        ).split(),
        "inverse_dynamics",
    ),
}
# Words of ``velocity_reference`` for a servo that brakes all motion, not what differs from the command's.
_NO_REFERENCE = frozenset({"none", "zero", "0", "0.0", "off", "false"})


@dataclass(frozen=True, eq=False)
class StatedServo:
    """A position servo as far as a log describes it.

    Attributes:
        kp: ``(n_joints,)`` in the log's order [N·m/rad], NaN where it is not stated.
        kd: ``(n_joints,)`` [N·m·s/rad], NaN where it is not stated.
        feedforwards: forms that it may have.
        follows: whether damping acts on the velocity's error; both where that is open.
        missing: what is not stated, in words.
    """

    kp: Array
    kd: Array
    feedforwards: tuple[str, ...]
    follows: tuple[bool, ...]
    missing: tuple[str, ...]


def stated_servo(controller: Mapping[str, Any] | None, joints: tuple[str, ...]) -> StatedServo:
    """Read ``controller``.

    Args:
        controller: of the log's header.
        joints: of the log.

    Raises:
        LogError: it is no position servo, or one with an integral part; a gain is no number.
    """
    said = dict(controller or {})
    mode = said.get("mode", "position")
    if mode != "position":
        raise LogError(f"mode {mode!r} is no position servo", field="controller.mode", remedy=_REMEDY)
    kp, kd, ki = (_read_gains(said.get(name), name, joints) for name in ("kp", "kd", "ki"))
    if np.nan_to_num(ki).any():
        raise LogError(
            "what an integral part had come to when a trial began is not in a log of commands",
            field="controller.ki",
            remedy=_REMEDY,
        )
    word = str(said.get("feedforward", "")).lower()
    reference = str(said["velocity_reference"]).lower() if "velocity_reference" in said else None
    missing = [
        f"{name} of {joint}"
        for name, gains in (("kp", kp), ("kd", kd))
        for joint, gain in zip(joints, gains, strict=True)
        if np.isnan(gain)
    ]
    return StatedServo(
        kp,
        kd,
        (_WORDS[word],) if word in _WORDS else FEEDFORWARDS,
        (True, False) if reference is None else (reference not in _NO_REFERENCE,),
        (*missing, *(() if word in _WORDS else ("the feedforward",))),
    )


def _read_gains(value: Any, name: str, joints: tuple[str, ...]) -> Array:
    """Gains by joint, in the order of the joints, or one for all, ``(n_joints,)``; NaN where there is none."""
    try:
        if isinstance(value, Mapping):
            return np.array([float(value.get(joint, np.nan)) for joint in joints])
        if isinstance(value, Sequence) and not isinstance(value, str) and len(value) == len(joints):
            return np.array([float(gain) for gain in value])
        return np.full(len(joints), np.nan if value is None else float(value))
    except (TypeError, ValueError) as error:
        raise LogError(
            f"{value!r} has a gain that is no number",
            field=f"controller.{name}",
            remedy="write one number, or one for each joint",
        ) from error


def known_servo(robot: Robot, log: Log, trials: dict[str, Signals]) -> Servo:
    """The servo as stated, what is not stated estimated on the identification trials.

    Unknown gains are fitted together with inertial parameters near the nominal ones, friction, rotor inertia and
    a constant, for every form that is not stated; the form that leaves least is taken. The scale of all torques
    is the nominal masses'. Stated gains are fitted as well, to be compared.

    Args:
        robot: the nominal model.
        trials: signals of its identification trials by name.

    Raises:
        LogError: ``controller`` says something else than a position servo, or no gain can be had.
    """
    joints = log.header.joints
    stated = stated_servo(log.header.controller, joints)
    kp, kd = stated.kp, stated.kd
    unknown = np.isnan([kp, kd])
    errors = [(s, s.commanded.value - s.measured.value) for s in trials.values()]
    rows = gain_rows(robot, log, errors, _FIT_HZ)
    forms = [(kind, way) for kind in stated.feedforwards for way in stated.follows]
    best = min((fit_gains(rows, kp, kd, *form) for form in forms), key=lambda fit: fit.doubted_loss)
    form = best.servo.feedforward, best.servo.follows_velocity
    if form[0] != "inverse_dynamics":
        slower = gain_rows(robot, log, errors, _SLOW_HZ)
        again = fit_gains(slower, kp, kd, *form)
        if again.joints_with_gain.sum() >= best.joints_with_gain.sum():
            rows, best = slower, again if unknown.any() else best
    if not best.joints_with_gain.all():
        weak = ", ".join(j for j, sound in zip(joints, best.joints_with_gain, strict=True) if not sound)
        raise LogError(
            f"gains cannot be estimated from this motion ({weak})",
            field="controller",
            remedy="state controller.kp, controller.kd and controller.feedforward",
        )
    told = np.full((2, 2, len(joints)), np.nan)
    free = np.full(len(joints), np.nan)
    for these, known_kp, known_kd in ((unknown, kp, kd), (~unknown, free, free)):
        if these.any():
            servo = best.servo if these is unknown else fit_gains(rows, known_kp, known_kd, *form).servo
            found = np.array([[servo.kp, servo.kd], spread_of_gains(rows, known_kp, known_kd, servo)])
            told[:, these] = found[:, these]
    by_name = {"kp": told[:, 0], "kd": told[:, 1]}
    return replace(best.servo, estimated=stated.missing, told=by_name)


def estimate_gains(robot: Robot, log: Log, servo: Servo) -> list[Absorbed]:
    """Gains as the record tells them, beside those that the log states and in units of the servo's firmware.

    Args:
        log: the log; ``controller.drive``, one name or one a joint, is looked up in ``firmware.csv``.
        servo: as :func:`known_servo` has it.
    """
    said, joints = log.header.controller or {}, log.header.joints
    stated, drive = stated_servo(said, joints), said.get("drive")
    drives = drive if isinstance(drive, Mapping) else dict.fromkeys(joints, drive)
    with Path(__file__).with_name("firmware.csv").open(encoding="utf-8", newline="") as file:
        table = {
            (row["drive"], row["gain"]): row
            for row in csv.DictReader(line for line in file if line[0] != "#")
        }
    made = []
    # A command acts at once or is held till the next row: by so much, kp times it, the damping of its motion is open.
    held = servo.told["kp"][0] / (np.sqrt(3.0) * log.header.rate_hz)
    for name, unit, given in (("kp", "N·m/rad", stated.kp), ("kd", "N·m·s/rad", stated.kd)):
        values, spread = servo.told[name]
        spread = np.hypot(spread, held) if name == "kd" else spread
        known = dict(zip(joints, given.tolist(), strict=True))
        for item in estimated_gains(
            robot, joints, name, unit, values, (values > 0.0) & np.isfinite(values), spread
        ):
            row = table.get((str(drives.get(item.joint)).lower(), name))
            each = item.size.value / float(row["newton_metres_per_unit"]) if row else None
            here = None if np.isnan(known[item.joint]) else known[item.joint]
            made.append(replace(item, given=here, firmware=each, firmware_unit=row["unit"] if row else None))
    return made


# Rows that gains are fitted to, and the fit of one form of servo together with what it drives.


@dataclass(frozen=True, eq=False)
class Rows:
    """What gains are fitted to.

    Attributes:
        signals: filtered, ``(n, n_joints)`` by name.
        bodies: columns of the inertial parameters ``(n, n_joints, p)``, each in units of its deviation a priori.
        aside: torques of gravity of 1 m/s² along two level axes, ``(n, n_joints, 2)``.
    """

    signals: dict[str, Array]
    bodies: Array
    aside: Array

    def leave_out_rows(self, left_out: NDArray[np.intp]) -> Rows:
        """All rows but some."""
        signals = {name: np.delete(values, left_out, axis=0) for name, values in self.signals.items()}
        return Rows(signals, *(np.delete(values, left_out, axis=0) for values in (self.bodies, self.aside)))

    @property
    def turning_rows(self) -> NDArray[np.bool_]:
        """Rows in which each joint turns, ``(n, n_joints)``; all of one that hardly does."""
        turning = np.abs(self.signals["sign"]) > _TURNING
        return turning | (turning.mean(axis=0) < _ENOUGH)

    def of_drive(self, j: int) -> Array:
        """Friction, rotor inertia and a constant of a joint, ``(n, 4)``."""
        columns = [self.signals[name][:, j] for name in ("sign", "v", "a")]
        return np.column_stack([*columns, np.ones(len(self.bodies))])


def gain_rows(robot: Robot, log: Log, trials: list[tuple[Signals, Array]], cut_hz: float) -> Rows:
    """Rows that gains are fitted to.

    Args:
        robot: the nominal model.
        trials: signals, and what a gain is of: position errors or currents ``(n, n_joints)``.
        cut_hz: cut-off of the low-pass on all of them [Hz].
    """
    rate, edge = log.header.rate_hz, round(0.3 * log.header.rate_hz)
    take = slice(edge, -edge, max(1, round(rate / _ROWS_HZ)))
    index = [robot.joint_index(name) for name in log.header.joints]
    level = robot.model.copy()
    parts: dict[str, list[Array]] = {}
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
        rows = {name: lowpass(x, rate, min(cut_hz, 0.2 * rate))[take] for name, x in made.items()}
        motion = np.zeros((3, len(rows["e"]), robot.model.nv))
        motion[0] = robot.rest
        motion[:, :, index] = [x[take] for x in (s.measured.value, s.measured.first, s.measured.second)]
        rows["bodies"] = joint_torque_regressor(robot.model, *motion)[:, index]
        aside = []
        for axis in level_axes(robot.model.gravity.linear)[:2]:
            level.gravity.linear = axis
            aside.append(inverse_dynamics(level, motion[0], 0.0 * motion[0], 0.0 * motion[0])[:, index])
        rows["aside"] = np.stack(aside, axis=2)
        for name, values in rows.items():
            parts.setdefault(name, []).append(values)
    mass = np.maximum(robot.nominal_parameters.reshape(-1, 10)[:, 0], 0.02)
    unit = _MASS * (mass[:, None] * 0.15 ** np.array([0] + [1] * 3 + [2] * 6)).ravel()
    signals = {name: np.concatenate(values) for name, values in parts.items()}
    bodies, aside_of_all = signals.pop("bodies") * unit, signals.pop("aside")
    return Rows(signals, bodies, aside_of_all)


@dataclass(frozen=True, eq=False)
class GainFit:
    """One form of the servo, fitted.

    Attributes:
        servo: the servo; a gain that is not to be had is not positive.
        loss: ``(n_joints,)`` logarithm of what is left of each joint's position error; where no gain is had, of what
            friction, rotor inertia and a constant of any size leave.
    """

    servo: Servo
    loss: Array

    @property
    def joints_with_gain(self) -> NDArray[np.bool_]:
        """Joints with a gain."""
        return np.asarray((self.servo.kp > 0.0) & np.isfinite(self.servo.kp))

    @property
    def doubted_loss(self) -> float:
        """Mean loss, more for what has to leave less to be believed: damping of the velocity itself, or none."""
        damped = self.servo.kd > _DAMPED_S * self.servo.kp
        doubt = 0.0 if damped[self.joints_with_gain].sum() > 0.5 * self.joints_with_gain.sum() else _UNDAMPED
        return float(self.loss.mean()) + (doubt if self.servo.follows_velocity else _DOUBT)


def fit_gains(rows: Rows, kp: Array, kd: Array, kind: str, follows: bool) -> GainFit:
    """Gains where they are not known, in turn with the inertial parameters.

    Residuals are compared as position errors, torques over kp: what friction the model has not is then an error of
    the position, and a smaller scale of all torques, gains and friction together gains nothing.

    Args:
        kp: gains that are known, NaN where they are not.
        kd: alike.
        kind: of feedforward.
        follows: whether damping acts on the velocity's error.
    """
    x, turning, size = rows.signals, rows.turning_rows, rows.bodies.shape[2]
    rate = (x["vc"] if follows else 0.0) - x["v"]
    before = x["nominal"] - (x[kind] if kind != "none" else 0.0)
    joints = range(len(kp))
    here = [turning[:, j] for j in joints]
    drives = [rows.of_drive(j)[here[j]] for j in joints]
    weight = _CORRELATED * (_EQUATION * np.maximum(x["nominal"].std(axis=0), 1e-9)) ** 2
    delta: Array = np.zeros(size)
    found = np.array([kp, kd])
    rest, sound = before.std(axis=0), np.zeros(len(kp), dtype=np.bool_)
    for _ in range(_ROUNDS):
        need = before + rows.bodies @ delta
        for j in joints:
            # Damping of the velocity itself and viscous friction are one; it is a servo's that has no other damping.
            drive = drives[j] if follows or np.isfinite(kd[j]) else drives[j][:, [0, 2, 3]]
            error, asked, turned = (values[here[j], j] for values in (x["e"], need, rate))
            found[:, j] = _gains_of_joint(error, asked, turned, drive, kp[j], kd[j])
        sound = found[0] > 0.0
        if not sound.any():
            break
        asked = found[0] * x["e"] + found[1] * rate - before
        parts = [_without_own(drives[j], rows.bodies[here[j], j], asked[here[j], j]) for j in joints]
        gram, right = np.eye(size), np.zeros(size)
        for j in np.flatnonzero(sound):
            body, torque = parts[j]
            gram += body.T @ body / weight[j]
            right += body.T @ torque / weight[j]
        delta = np.asarray(np.linalg.solve(gram, right), dtype=np.float64)
        rest = np.array([(torque - body @ delta).std() for body, torque in parts])
    bare = [
        (x["e"][:, j] - rows.of_drive(j) @ _least_squares(rows.of_drive(j), x["e"][:, j])).std()
        for j in joints
    ]
    left = np.where(sound, rest / found[0], bare)
    return GainFit(Servo(found[0], found[1], kind, follows), np.log(np.maximum(left, 1e-15)))


def _gains_of_joint(
    error: Array, need: Array, rate: Array, drive: Array, kp: float, kd: float
) -> tuple[float, float]:
    """Gains given the torque that the bodies need, ``error = (need − kd·rate + friction)/kp``; known where not NaN."""
    if not np.isnan(kp):
        if np.isnan(kd):
            kd = max(float(_least_squares(np.column_stack([rate, drive]), need - kp * error)[0]), 0.0)
        return kp, kd
    if np.isnan(kd):
        slope, ratio = _least_squares(np.column_stack([need, -rate, drive]), error)[:2]
    else:
        slope, ratio = _least_squares(np.column_stack([need - kd * rate, drive]), error)[0], None
    kp = 1.0 / float(slope) if slope != 0.0 else np.inf
    return kp, kd if ratio is None else max(float(ratio), 0.0) * kp


def spread_of_gains(rows: Rows, kp: Array, kd: Array, fitted: Servo) -> Array:
    """Standard deviations of kp and kd by a jackknife over stretches of the record (Miller 1974), ``(2, n_joints)``.

    Args:
        rows: that the gains were fitted to.
        kp: gains that are known, NaN where they are not.
        kd: alike.
        fitted: the servo of all rows, whose form is taken.
    """
    made = []
    for left_out in np.array_split(np.arange(len(rows.bodies)), _STRETCHES):
        form = fitted.feedforward, fitted.follows_velocity
        servo = fit_gains(rows.leave_out_rows(left_out), kp, kd, *form).servo
        made.append((servo.kp, servo.kd))
    return np.asarray(np.std(made, axis=0) * np.sqrt(_STRETCHES - 1))


def _without_own(own: Array, *values: Array) -> list[Array]:
    """What a joint's own columns leave of others."""
    q = np.linalg.qr(own / np.maximum(np.linalg.norm(own, axis=0), 1e-12))[0]
    return [value - q @ (q.T @ value) for value in values]


def _least_squares(columns: Array, target: Array) -> Array:
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
    return np.linalg.lstsq(columns / size, target, rcond=1e-10)[0] / size


# Torque constants of motors.


def torque_constants(
    robot: Robot, log: Log, trials: dict[str, Signals], currents: dict[str, Array], known: Array
) -> Array:
    """Torque per current of every joint, ``(n_joints,)`` [N·m/A].

    Args:
        robot: the nominal model.
        trials: signals of its identification trials by name.
        currents: ``(n, n_joints)`` motor currents by the same names [A].
        known: ``(n_joints,)`` constants, NaN where they are not stated; those are estimated as gains are, or, where
            the bodies are given, beside what these may lack.

    Raises:
        LogError: one cannot be had from this motion.
    """
    if not np.isnan(known).any():
        return known
    # No command is involved: the velocity's error is nothing.
    still = {k: replace(s, commanded=s.measured) for k, s in trials.items()}
    rows = gain_rows(robot, log, [(still[k], currents[k]) for k in still], _FIT_HZ)
    if "rigid_body" in log.header.modelled:
        constants = fit_gains(rows, known, np.zeros_like(known), "none", True).servo.kp
    else:
        told = np.array([joint not in log.header.no_torque for joint in log.header.joints])
        constants = np.where(told, _constants_beside_bodies(rows, known, told), known)
    weak = [j for j, k in zip(log.header.joints, constants, strict=True) if not abs(k) > 1e-9]
    if weak:
        raise LogError(
            "torque constants cannot be estimated from this motion: " + ", ".join(weak),
            field="torque_constants",
            remedy="state torque_constants in log.yaml [N·m/A]",
        )
    return constants


@dataclass(frozen=True, eq=False)
class _ConstantFit:
    """Torque constants beside what a model may lack at some places.

    Attributes:
        per_torque: ``(n_joints,)`` current per torque [A/(N·m)].
        sigma: deviation of the currents that is left [A].
        least: deviation below which equations are not believed [A].
        rank: numbers of what is lacking that the motion shows.
    """

    per_torque: Array
    sigma: Array
    least: Array
    rank: int

    def nats_over(self, other: _ConstantFit, counts: Array) -> float:
        """Evidence for it over a fit with less (Schwarz 1978)."""
        left = (other.sigma**2 + self.least**2) / (self.sigma**2 + self.least**2)
        return 0.5 * float(counts @ np.log(left) - (self.rank - other.rank) * np.log(counts.sum()))


def _constants_beside_bodies(rows: Rows, known: Array, told: NDArray[np.bool_]) -> Array:
    """Torque constants ``(n_joints,)`` [N·m/A] of an arm with given bodies, which fix the scale of every current.

    A load that nobody knew of asks for more current where it is heavy: alone, constants would take that up. So they
    are fitted beside a body at each link, and gravity aside of a tilted base, one place more as long as that is worth
    its numbers.

    Args:
        rows: with currents for ``e``.
        known: constants, NaN where they are not stated.
        told: joints whose currents mean something.
    """
    lacking = [*np.split(rows.bodies, rows.bodies.shape[2] // 10, axis=2), rows.aside]
    used = np.flatnonzero(told)
    counts = rows.turning_rows[:, used].sum(axis=0) / _CORRELATED
    best, chosen = _fit_constants(rows, known, used, []), list[int]()
    while len(chosen) < len(lacking):
        others = [k for k in range(len(lacking)) if k not in chosen]
        tried = [_fit_constants(rows, known, used, [lacking[i] for i in (*chosen, k)]) for k in others]
        nats = [fit.nats_over(best, counts) - np.log(len(lacking)) for fit in tried]
        if max(nats) <= 0.0:
            break
        chosen.append(others[int(np.argmax(nats))])
        best = tried[int(np.argmax(nats))]
    constants = known.copy()
    constants[used] = 1.0 / best.per_torque
    return constants


def _fit_constants(
    rows: Rows, known: Array, used: NDArray[np.intp], lacking: Sequence[Array]
) -> _ConstantFit:
    """``i = g (τ_nominal + C x) + drive`` of all joints together by Gauss and Newton's steps.

    The first one is for torques that are constants times currents, which is linear: nearly right, but for the noise of
    the currents.
    """
    turning = rows.turning_rows
    here = {j: turning[:, j] for j in used}
    current, nominal = ({j: rows.signals[name][here[j], j] for j in used} for name in ("e", "nominal"))
    drive = {j: rows.of_drive(j)[here[j]] for j in used}
    columns = {
        j: np.hstack([np.zeros((len(current[j]), 0)), *(c[here[j], j] for c in lacking)]) for j in used
    }

    def at_size(x: Array, rank: int) -> _ConstantFit:
        found = []
        for j in used:
            asked, stated = nominal[j] + columns[j] @ x, known[j]
            own = drive[j] if stated == stated else np.column_stack([asked, drive[j]])
            target = current[j] - (asked / stated if stated == stated else 0.0)
            per = 1.0 / stated if stated == stated else float(_least_squares(own, target)[0])
            left = max(float(_without_own(own, target)[0].std()), 1e-12)
            found.append((per, left, _EQUATION * abs(per) * float(asked.std())))
        per_torque, sigma, least = np.array(found).T
        return _ConstantFit(per_torque, sigma, least, rank)

    x = np.zeros(columns[used[0]].shape[1])
    fit = at_size(x, 0)
    for step in range(_STEPS if len(x) else 0):
        parts = []
        for k, j in enumerate(used):
            asked, stated = nominal[j] + columns[j] @ x, not np.isnan(known[j])
            if step:
                own, target = asked, current[j] - (asked / known[j] if stated else 0.0)
                made = fit.per_torque[k] * columns[j]
            else:
                own, target = current[j], (known[j] * current[j] if stated else 0.0) - nominal[j]
                made = columns[j]
            made, target = _without_own(
                drive[j] if stated else np.column_stack([own, drive[j]]), made, target
            )
            sigma = fit.sigma[k] if step else max(float(target.std()), 1e-12)
            parts.append((made / sigma, target / sigma))
        matrix, right = (np.concatenate(part) for part in zip(*parts, strict=True))
        size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-12)
        change, _, rank, _ = np.linalg.lstsq(matrix / size, right, rcond=_BLIND)
        x = x + change / size
        fit = at_size(x, int(rank))
    return fit
