"""Torques that mean something else than the log says: too weak to be torques, or of the other side of the gear."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.doctor.check import Check, Outcome
from excite.doctor.doubt import Doubt
from excite.doctor.drive_fit import drive_fit
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import TorqueSamples, torque_samples
from excite.doctor.unknown_unit import of_unknown_unit, said_of_unit
from excite.finding import Finding, list_names
from excite.logs.log import Log
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot

# Nominal masses would have to be five times too large.
_WEAK = 0.2
# And no likely body, friction or rotor explains more than a fifth of the torque's power.
_UNEXPLAINED = 0.8
_DRIVE_SHARE = 0.15
_ROTOR_SHARE = 0.3
# A model without bodies says nothing of rotors beside them [kg·m²].
_WEIGHTLESS = 1e-7


class WeakTorques(Check):
    """Torques far below what the nominal masses need, of some joints or of most."""

    kinds = ("weak_torque", "torque_scale")

    def examine(self, robot: Robot, log: Log) -> Outcome:
        samples = _samples(robot, log)
        if samples is None:
            return Outcome(log)
        reading = Reading.as_stated(log)
        parts = None if log.header.torque == "current" else of_unknown_unit(samples, reading)
        if parts is not None:
            return Outcome(log, (said_of_unit(samples, parts, reading),), frozenset({Doubt.SIZE}))
        gains, _ = samples.gains(reading)
        weak = (samples.judged(reading)[:-1] > 0.5 * np.log(_UNEXPLAINED)) & (np.abs(gains) < _WEAK)
        # What a spring or a cable takes hides the bodies' torque and is large; what a dead channel reads is small.
        read, needed = samples.measured_torque(reading).std(axis=0), samples.predicted(reading)[0].std(axis=0)
        weak &= read < _WEAK * needed
        # A torque that is cut off is weaker than it was.
        weak &= ~np.array([_cut_off(log, name) for name in samples.channels], dtype=np.bool_)
        if not weak.any() or 2 * weak.sum() > len(weak):
            return Outcome(log)
        names = tuple(name for name, flag in zip(samples.channels, weak, strict=True) if flag)
        text = (
            f"torques of {list_names(names)} are at most {max(float(gains[weak].max()), 0.0):.2g} times what the nominal "
            "masses need, unlike the others: a dead channel, or another unit"
        )
        finding = Finding(
            "weak_torque",
            text,
            {"joints": float(len(names))},
            names,
            severity="spoils",
            sure=0.8,
            repaired=True,
            remedy="they are taken as no_torque; name them there, or correct the unit",
        )
        header = log.header.model_copy(update={"no_torque": (*log.header.no_torque, *names)})
        return Outcome(replace(log, header=header), (finding,))


def _cut_off(log: Log, joint: str) -> bool:
    j = log.header.joints.index(joint)
    return any(trial.beyond is not None and trial.beyond[:, j].any() for trial in log.trials)


class TorqueSide(Check):
    """Torques called link-side that hold the rotors' inertia or the gears' friction.

    Rotors show at the outer joints, which carry little else.
    """

    kinds = ("torque_side",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        samples = _samples(robot, log)
        if samples is None or log.header.torque != "link_side":
            return Outcome(log)
        outer, rubbing = _rotors(samples, Reading.as_stated(log))
        joints = samples.channels
        # Friction alone is seen behind the gear too, in bearings and seals; inertia that is negative is no rotor's.
        if outer < (0.0 if 2 * rubbing > len(joints) else _ROTOR_SHARE):
            return Outcome(log)
        text = (
            f"torques are called link_side, yet they hold rotor inertia ({outer:.2g} times the links' own at the outer "
            f"joints) and friction ({rubbing} joints): they look motor-side"
        )
        finding = Finding(
            "torque_side",
            text,
            {"rotor_share": outer, "joints": float(rubbing)},
            joints,
            severity="spoils",
            sure=0.8,
            remedy="write torque: motor_side, or friction and rotors go into the links",
        )
        return Outcome(log, (finding,))


def _samples(robot: Robot, log: Log) -> TorqueSamples | None:
    if log.header.free_base or log.header.torque in {None, "none"}:
        return None
    return torque_samples(robot, log)


def _rotors(samples: TorqueSamples, reading: Reading) -> tuple[float, int]:
    """Rotor inertia at the outer joints, as share of the links', and the number of joints that rub."""
    model, drive = samples.predicted(reading)
    torque, own = samples.measured_torque(reading), _own_inertia(samples)
    rotors, rubbing = [], 0
    for j in np.flatnonzero(own > _WEIGHTLESS):
        weights, friction = drive_fit(torque[:, j], model[:, j], drive.v[:, j], drive.a[:, j])
        rotors.append(weights[-1] / max(float(own[j]), 1e-12))
        moving = torque[:, j] - torque[:, j].mean()
        rubbing += float(friction @ friction) > _DRIVE_SHARE * float(moving @ moving)
    return float(np.median(rotors[-max(1, len(rotors) // 2) :])) if rotors else 0.0, int(rubbing)


def _own_inertia(samples: TorqueSamples) -> Array:
    """Mean inertia that each measured joint has by the nominal model, ``(n_torques,)``: torque per acceleration."""
    some = slice(None, None, max(1, len(samples.q) // 20))
    q, rest = samples.q[some], np.zeros_like(samples.v[some])
    model, found = samples.robot.model, []
    still = inverse_dynamics(model, q, rest, rest)
    for place in samples.places[samples.measured]:
        push = rest.copy()
        push[:, place] = 1.0
        turned = inverse_dynamics(model, q, rest, push)
        found.append(float(np.mean((turned - still)[:, place])))
    return np.array(found)
