"""Gains and feedforward of a servo that the log does not state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.effects.bodies import likeliest_body, reach
from excite.diagnosis.servo.gain_fit import (
    CORRELATED,
    EQUATION,
    Rows,
    Tried,
    beside,
    fitted_servo,
    gain_rows,
    spread_of_gains,
    turning_rows,
)
from excite.diagnosis.servo.servo import FEEDFORWARDS, Servo, Signals, error_integral
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


# Torque constants of an arm whose bodies are given, fitted together with what its model may lack.
#
# Bodies that are given fix the scale of every joint's current. A load that nobody knew of asks for more of it
# where it is heavy: alone, constants would take that up, and what is left of its torques would look like
# anything else. So they are fitted beside a body at each link, and beside gravity aside of a tilted base, as
# long as that is worth its numbers.

_STEPS, _NEAR = 40, 1e-5
# Directions of a body that the motion does not show, relative.
_BLIND = 1e-9
# How often what was found first is fitted again beside what was found later.
_AGAIN = 3


@dataclass(frozen=True, eq=False)
class _Joint:
    """One joint's rows.

    Attributes:
        current: ``(n,)`` [A].
        nominal: ``(n,)`` torque of the bodies as given [N·m].
        beside: ``(n, 4)`` columns of its drive.
        lacking: by place, ``(n, p)`` torques of what the model may lack.
        known: torque constant, NaN where it is not stated.
    """

    current: Array
    nominal: Array
    beside: Array
    lacking: tuple[Array, ...]
    known: float

    @property
    def stated(self) -> bool:
        """Whether its constant is."""
        return not np.isnan(self.known)

    def asked(self, sizes: Sequence[Array]) -> Array:
        """Torque of the bodies with what is lacking, ``(n,)`` [N·m]."""
        torque = self.nominal
        for columns, size in zip(self.lacking, sizes, strict=True):
            torque = torque + columns @ size if size.any() else torque
        return torque

    def per_torque(self, asked: Array) -> tuple[float, float]:
        """Current per torque [A/(N·m)] where the bodies ask for so much, and the deviation of the current left [A]."""
        columns = self.beside if self.stated else np.column_stack([asked, self.beside])
        target = self.current - asked / self.known if self.stated else self.current
        scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
        x = np.linalg.lstsq(columns / scale, target, rcond=1e-10)[0] / scale
        found = 1.0 / self.known if self.stated else float(x[0])
        return found, max(float((target - columns @ x).std()), 1e-12)

    def rest_of_torques(self, asked: Array, columns: Array) -> tuple[Array, Array]:
        """Columns and what they have to explain, where torques are a constant times currents, which is linear."""
        if self.stated:
            return _projected(self.beside, columns, self.known * self.current - asked)
        return _projected(np.column_stack([self.current, self.beside]), columns, -asked)

    def rest_of_currents(self, asked: Array, columns: Array, per_torque: float) -> tuple[Array, Array]:
        """The same where currents are torques over a constant, as it is."""
        if self.stated:
            return _projected(self.beside, per_torque * columns, self.current - asked / self.known)
        return _projected(np.column_stack([asked, self.beside]), per_torque * columns, self.current)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Constants beside what the model may lack.

    Attributes:
        sizes: by place.
        per_torque: ``(n_joints,)`` current per torque [A/(N·m)].
        sigma: ``(n_joints,)`` deviation of the currents that is left [A].
        least: ``(n_joints,)`` deviation below which equations are not believed [A].
        n_told: numbers that the motion shows of what was fitted last.
    """

    sizes: tuple[Array, ...]
    per_torque: Array
    sigma: Array
    least: Array
    n_told: int = 0


def constants_beside_bodies(robot: Robot, rows: Rows, known: Array, told: NDArray[np.bool_]) -> Array:
    """Torque constants ``(n_joints,)`` [N·m/A] of an arm with given bodies.

    Args:
        robot: the nominal model.
        rows: with currents for ``e``.
        known: ``(n_joints,)`` constants, NaN where they are not stated.
        told: ``(n_joints,)`` joints whose currents mean something.
    """
    joints = _joints(rows, known, told)
    masses = [float(inertia.mass) for inertia in list(robot.model.inertias)[1:]]
    search = _Search(joints, masses, reach(robot.model))
    chosen: list[int] = []
    best = search.made([np.zeros(block.shape[1]) for block in joints[0].lacking])
    while True:
        rest = [k for k in range(len(best.sizes)) if k not in chosen]
        tried = [search.fitted(best, k) for k in rest]
        gains = [search.gain(best, fit) for fit in tried]
        if not gains or max(gains) <= 0.0:
            break
        place = int(np.argmax(gains))
        chosen.append(rest[place])
        best = tried[place]
        for _ in range(_AGAIN if len(chosen) > 1 else 0):
            for k in chosen:
                best = search.fitted(best, k)
    constants = known.copy()
    constants[told] = 1.0 / best.per_torque
    return constants


def _joints(rows: Rows, known: Array, told: NDArray[np.bool_]) -> list[_Joint]:
    """Joints whose currents mean something, each in the rows in which it turns; bodies first, gravity aside last."""
    x, turning = rows.signals, turning_rows(rows.signals["sign"])
    bodies, made = rows.bodies / rows.unit, []
    for j in np.flatnonzero(told):
        here = turning[:, j]
        links = np.split(bodies[here, j], bodies.shape[2] // 10, axis=1)
        lacking = (*links, rows.aside[here, j])
        drive = beside(x, int(j))[here]
        made.append(_Joint(x["e"][here, j], x["nominal"][here, j], drive, lacking, float(known[j])))
    return made


@dataclass(frozen=True, eq=False)
class _Search:
    """Fits of constants beside what is lacking at one place after the other.

    Attributes:
        joints: their rows.
        masses: by link [kg].
        reach: largest distance of a body's parts from the joint that carries it [m].
    """

    joints: list[_Joint]
    masses: list[float]
    reach: float

    def gain(self, before: _Fit, after: _Fit) -> float:
        """Nats of a fit over one with less, less the price of what was fitted last."""
        counts = np.array([len(joint.current) for joint in self.joints]) / CORRELATED
        left = (before.sigma**2 + after.least**2) / (after.sigma**2 + after.least**2)
        price = 0.5 * after.n_told * np.log(counts.sum()) + np.log(len(after.sizes))
        return 0.5 * float(counts @ np.log(left)) - float(price)

    def made(self, sizes: Sequence[Array], n_told: int = 0) -> _Fit:
        """Constants at some sizes of what is lacking."""
        asked = [joint.asked(sizes) for joint in self.joints]
        found = [joint.per_torque(torque) for joint, torque in zip(self.joints, asked, strict=True)]
        per_torque, sigma = (np.array(values) for values in zip(*found, strict=True))
        least = EQUATION * np.abs(per_torque) * np.array([float(torque.std()) for torque in asked])
        return _Fit(tuple(sizes), per_torque, sigma, least, n_told)

    def fitted(self, begun: _Fit, place: int) -> _Fit:
        """Constants beside what is lacking at a place and what was found at others."""
        sizes = list(begun.sizes)
        sizes[place] = np.zeros(len(sizes[place]))
        parts = [joint.rest_of_torques(joint.asked(sizes), joint.lacking[place]) for joint in self.joints]
        own = np.array([max(float(y.std()), 1e-12) for _, y in parts])
        # Of torques it is linear, and nearly right: noise of the currents makes constants smaller. A load of many times
        # what a wrist weighs is told by the joints before it, whose own torques are the largest.
        found = [self._from(begun, place, parts, sigma) for sigma in (own, np.full(len(own), own.max()))]
        return max(found, key=lambda fit: self.gain(begun, fit))

    def _from(self, begun: _Fit, place: int, parts: list[tuple[Array, Array]], sigma: Array) -> _Fit:
        """The same by Gauss and Newton's steps, the first one for what ``parts`` leave at deviations ``sigma``."""
        sizes, now = list(begun.sizes), begun
        sizes[place] = np.zeros(len(sizes[place]))
        for _ in range(_STEPS):
            sizes[place], n_told = self._size(place, parts, sigma, sizes[place])
            now, last = self.made(sizes, n_told), now
            if np.allclose(now.per_torque, last.per_torque, rtol=_NEAR, atol=0.0):
                break
            sigma = now.sigma
            parts = [
                joint.rest_of_currents(joint.asked(sizes), joint.lacking[place], g)
                for joint, g in zip(self.joints, now.per_torque, strict=True)
            ]
        return now

    def _size(
        self, place: int, parts: Sequence[tuple[Array, Array]], sigma: Array, size: Array
    ) -> tuple[Array, int]:
        """What is lacking at a place, and how many of its numbers the motion shows: of bodies one that can exist."""
        columns = np.concatenate([block / s for (block, _), s in zip(parts, sigma, strict=True)])
        rest = np.concatenate([y / s for (_, y), s in zip(parts, sigma, strict=True)])
        information = columns.T @ columns
        target = information @ size + columns.T @ rest
        scale = np.sqrt(np.diag(information))
        scale = np.where(scale > 0.0, scale, 1.0)
        n_told = int(np.linalg.matrix_rank(information / np.outer(scale, scale), _BLIND, hermitian=True))
        if place < len(self.masses):
            found = likeliest_body(information, target, self.reach, self.masses[place])
            return (np.zeros(len(size)) if found is None else found), n_told
        inverse = np.linalg.pinv(information / np.outer(scale, scale), _BLIND, hermitian=True)
        return np.asarray(inverse @ (target / scale) / scale), n_told


def _projected(own: Array, lacking: Array, target: Array) -> tuple[Array, Array]:
    """What a joint's own columns leave of others, and of a target."""
    q = np.linalg.qr(own / np.maximum(np.linalg.norm(own, axis=0), 1e-12))[0]
    return lacking - q @ (q.T @ lacking), target - q @ (q.T @ target)


# What ``controller`` of a log says about its servo.

_REMEDY = "log tau.* or tau_cmd.* with such a controller"
# Words of ``feedforward`` and the three forms that they mean.
_WORDS = {
    "none": "none",
    "off": "none",
    "gravity": "gravity",
    "gravity_compensation": "gravity",
    "inverse_dynamics": "inverse_dynamics",
    "computed_torque": "inverse_dynamics",
    "rigid_body": "inverse_dynamics",
    "rigid_body_dynamics": "inverse_dynamics",
    "rnea": "inverse_dynamics",
    "nominal": "inverse_dynamics",
    "nominal_model": "inverse_dynamics",
    "model": "inverse_dynamics",
    "full": "inverse_dynamics",
}
# Words of ``velocity_reference`` for a servo that brakes all motion, not what differs from the command's.
_NO_REFERENCE = frozenset({"none", "zero", "0", "0.0", "off", "false"})


@dataclass(frozen=True, eq=False)
class Stated:
    """A position servo as far as a log describes it.

    Attributes:
        kp: ``(n_joints,)`` in the log's order [N·m/rad], NaN where it is not stated.
        kd: ``(n_joints,)`` [N·m·s/rad], NaN where it is not stated.
        ki: ``(n_joints,)`` [N·m/(rad·s)], 0 where it is not stated.
        feedforwards: forms that it may have.
        follows: whether damping acts on the velocity's error; both where that is open.
        missing: what is not stated, in words.
        rate_hz: of the servo, None where it is not stated [Hz].
    """

    kp: Array
    kd: Array
    ki: Array
    feedforwards: tuple[str, ...]
    follows: tuple[bool, ...]
    missing: tuple[str, ...]
    rate_hz: float | None = None


def stated_servo(controller: Mapping[str, Any] | None, joints: tuple[str, ...]) -> Stated:
    """Read ``controller``.

    Args:
        controller: of the log's header.
        joints: of the log.

    Returns:
        What it says.

    Raises:
        LogError: it is no position servo; a gain or the rate is no number; ki is stated without kp.
    """
    said = dict(controller or {})
    mode = said.get("mode", "position")
    if mode != "position":
        raise LogError(f"mode {mode!r} is no position servo", field="controller.mode", remedy=_REMEDY)
    kp, kd, ki = (_gains(said.get(name), name, joints) for name in ("kp", "kd", "ki"))
    ki = np.nan_to_num(ki)
    if np.isnan(kp[ki != 0.0]).any():
        raise LogError(
            "an integral part without kp cannot be told from a slow effect",
            field="controller.ki",
            remedy="state controller.kp, or log tau_cmd.*",
        )
    word = str(said.get("feedforward", "")).lower()
    reference = str(said["velocity_reference"]).lower() if "velocity_reference" in said else None
    missing = [
        f"{name} of {joint}"
        for name, gains in (("kp", kp), ("kd", kd))
        for joint, gain in zip(joints, gains, strict=True)
        if np.isnan(gain)
    ]
    if word not in _WORDS:
        missing.append("the feedforward")
    return Stated(
        kp,
        kd,
        ki,
        (_WORDS[word],) if word in _WORDS else FEEDFORWARDS,
        (True, False) if reference is None else (reference not in _NO_REFERENCE,),
        tuple(missing),
        _rate(said.get("rate_hz")),
    )


def _rate(value: Any) -> float | None:
    """The servo's rate [Hz]; None where it is not stated."""
    if value is None:
        return None
    try:
        rate = float(value)
    except (TypeError, ValueError):
        rate = 0.0
    if not 0.0 < rate < np.inf:
        raise LogError(
            f"{value!r} is no rate",
            field="controller.rate_hz",
            remedy="write cycles per second, or leave it out",
        )
    return rate


def _gains(value: Any, name: str, joints: tuple[str, ...]) -> Array:
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
