"""Mistakes in a log that its robot's nominal model betrays: signs, order of joints, units, side of the gear.

Nominal inertias are off by some tenths, and friction is not known; a turned sign or an exchanged joint spoils
the prediction by far more. Each mistake is tried, and named where undoing it explains the torques far better.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from excite.arrays import Array
from excite.doctor.torque_samples import (
    FLOOR,
    TorqueSamples,
    mean_left,
    modelled_gains,
    own_inertia,
    scaled_fit,
    share_left,
    shares_left,
    torque_samples,
)
from excite.doctor.weak_torques import weak_torques
from excite.doctor.zero_positions import best_zeros
from excite.finding import Finding, listed
from excite.logs.log import Log
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings

# Mean over the joints of half the logarithm of the residual's power, in nats, that undoing has to bring.
_LEAST_GAIN = 0.3
# The same for one joint alone.
_LEAST_JOINT_GAIN = 0.5
_SCALE_OFF = 1.6
_DRIVE_SHARE = 0.15
_ROTOR_SHARE = 0.3
# More than this share of the power left is no explanation.
_FITS = 0.5


def suspicions(robot: Robot, log: Log, settings: ProblemSettings | None = None) -> tuple[Finding, ...]:
    """Likely mistakes in a log of joint torques; empty for logs of contact wrenches or commands.

    Args:
        robot: the robot.
        log: the log; its identification trials are looked at.
        settings: filters and gains; defaults if None.
    """
    settings = settings or ProblemSettings()
    if log.header.base == "floating" or log.header.torque in {None, "none"}:
        return ()
    samples = torque_samples(robot, log, settings)
    if samples is None:
        return ()
    arrangement = _arrangement(samples, log.header.torque_joints)
    if arrangement is not None:
        return (arrangement,)
    return (
        *weak_torques(samples, log.header.torque_joints),
        *_turned_torques(samples, log),
        *_motor_side(samples, log),
    )


def _arrangement(samples: TorqueSamples, joints: tuple[str, ...]) -> Finding | None:
    """The best explanation by exchanged joints, turned directions or degrees, if it is far better."""
    n = len(joints)
    same, straight = np.arange(n), np.ones(n)
    start = mean_left(samples)
    if start - 0.5 * np.log(FLOOR) < _LEAST_GAIN:
        return None
    in_radians = samples.arranged(same, straight * np.pi / 180.0, same)
    found = [
        (mean_left(in_radians), "degrees", "positions look like degrees; convert them to radians", joints)
    ]
    for j in range(n):
        signs = straight.copy()
        signs[j] = -1.0
        text = f"the sign of the position of {joints[j]} looks turned"
        found.append((mean_left(samples.arranged(same, signs, same)), "position_sign", text, (joints[j],)))
        both = samples.arranged(same, signs, same)
        both.torque[:, j] *= -1.0
        text = f"{joints[j]} looks turned about: signs of its position and its torque"
        found.append((mean_left(both), "direction", text, (joints[j],)))
    zeros = best_zeros(samples, start)
    places = tuple(joints[j] for j in np.flatnonzero(zeros.quarters))
    found.append((zeros.score, "zero_position", zeros.text(joints), places))
    found += [_torque_order(samples, joints), _torque_signs(samples, joints), _torque_scale(samples, joints)]
    for what, with_torques in (("columns", True), ("positions", False)):
        score, order = _reordered(samples, start, with_torques=with_torques)
        changed = np.flatnonzero(order != same)
        # An exchange that leaves a joint unexplained is none: a dead channel fits anywhere as badly.
        if (
            shares_left(samples.arranged(order, straight, order if with_torques else same))[changed] > _FITS
        ).any():
            continue
        moved = tuple(joints[i] for i in changed)
        real = ", ".join(joints[i] for i in order)
        text = f"joints look exchanged: the {what} explain the torques far better in the order {real}"
        found.append((score, "order", text, moved))
    score, kind, text, places = min(found, key=lambda item: item[0])
    if start - score < _LEAST_GAIN or not places:
        return None
    figures = {"left_before": float(np.exp(2.0 * start)), "left_after": float(np.exp(2.0 * score))}
    before, after = (min(100.0, 100.0 * figures[name]) for name in ("left_before", "left_after"))
    text += f" (the nominal model leaves {before:.0f} % of the torques' power as it is, {after:.0f} % then)"
    return Finding(kind, text, figures, places)


def _torque_order(samples: TorqueSamples, joints: tuple[str, ...]) -> tuple[float, str, str, tuple[str, ...]]:
    """Torque channels assigned to the joints whose torque they look like."""
    n, model = len(joints), samples.predicted()
    left = np.array(
        [[share_left(samples, samples.torque[:, i], model[:, j], j) for i in range(n)] for j in range(n)]
    )
    cost = 0.5 * np.log(np.maximum(left, FLOOR))
    rows, order = linear_sum_assignment(cost)
    moved = tuple(joints[j] for j in rows[rows != order])
    text = (
        f"torques look exchanged: those of {listed(moved)} fit channels "
        f"{listed([joints[i] for i in order[rows != order]])}"
    )
    return float(cost[rows, order].mean()), "order", text, moved


def _reordered(
    samples: TorqueSamples, start: float, *, with_torques: bool
) -> tuple[float, NDArray[np.int64]]:
    """The best order that exchanges of two joints at a time lead to, from the order as it is and reversed."""
    n = samples.torque.shape[1]
    straight, same = np.ones(n), np.arange(n)

    def score(order: NDArray[np.int64]) -> float:
        return mean_left(samples.arranged(order, straight, order if with_torques else same))

    best = (start, same)
    reverse = same[::-1].copy()
    for current in (best, (score(reverse), reverse)):
        while True:
            found = min(((score(o), tuple(o)) for o in _exchanges(current[1])), default=(np.inf, ()))
            if found[0] >= current[0] - 0.02:
                break
            current = (found[0], np.array(found[1]))
        best = min(best, current, key=lambda item: item[0])
    return best


def _exchanges(order: NDArray[np.int64]) -> Iterable[NDArray[np.int64]]:
    for i, j in combinations(range(len(order)), 2):
        other = order.copy()
        other[[i, j]] = other[[j, i]]
        yield other


def _sign_gains(samples: TorqueSamples) -> Array:
    """What turning each torque's sign brings, half the logarithm of the residual's power, ``(n_joints,)``."""
    model, gains = samples.predicted(), []
    for j in range(model.shape[1]):
        torque = samples.torque[:, j]
        straight, other = (share_left(samples, sign * torque, model[:, j], j) for sign in (1.0, -1.0))
        gains.append(0.5 * np.log(max(straight, FLOOR) / max(other, FLOOR)))
    return np.array(gains)


def _torque_signs(samples: TorqueSamples, joints: tuple[str, ...]) -> tuple[float, str, str, tuple[str, ...]]:
    """Torques with the signs that fit."""
    gains = _sign_gains(samples)
    turned = gains > _LEAST_JOINT_GAIN
    # Joints that do not tell go with the others where all that tell agree.
    if turned.sum() > 1 and (gains > -_LEAST_JOINT_GAIN).all():
        turned[:] = True
    signed = replace(samples, torque=samples.torque * np.where(turned, -1.0, 1.0))
    names = tuple(name for name, flag in zip(joints, turned, strict=True) if flag)
    return mean_left(signed), "torque_sign", _sign_text(names, joints), names


def _sign_text(turned: tuple[str, ...], joints: tuple[str, ...]) -> str:
    if len(turned) == len(joints):
        return "the sign of all torques looks turned: reaction instead of action"
    return f"the sign of the torque of {listed(turned)} looks turned"


def _turned_torques(samples: TorqueSamples, log: Log) -> list[Finding]:
    """Joints whose torque fits with the sign turned, though they do not weigh much among all."""
    model, gains = samples.predicted(), _sign_gains(samples)
    turned = tuple(
        name
        for j, name in enumerate(log.header.torque_joints)
        if gains[j] > _LEAST_JOINT_GAIN or (gains[j] > 0.0 and _drives_itself(samples, model[:, j], j))
    )
    if not turned:
        return []
    return [
        Finding("torque_sign", _sign_text(turned, log.header.torque_joints), {"joints": len(turned)}, turned)
    ]


def _drives_itself(samples: TorqueSamples, model: Array, joint: int) -> bool:
    """Whether the friction that fits best feeds power in, and is a good part of the torque."""
    columns = np.column_stack([model, samples.drive_columns(joint)])
    torque = samples.torque[:, joint]
    weights = scaled_fit(columns, torque)
    friction = columns[:, 2:4] @ weights[2:4]
    power = float((friction * columns[:, 2]).sum())
    total = float(((torque - torque.mean()) ** 2).sum())
    return power < 0.0 and float((friction**2).sum()) > _DRIVE_SHARE * total


def _torque_scale(samples: TorqueSamples, joints: tuple[str, ...]) -> tuple[float, str, str, tuple[str, ...]]:
    """All torques larger or smaller than the model's by a common factor."""
    gains, shares = modelled_gains(samples)
    told = shares > 0.3
    factor = float(np.median(gains[told])) if told.sum() > 1 else 1.0
    if factor <= 0.0 or 1.0 / _SCALE_OFF < factor < _SCALE_OFF:
        return np.inf, "torque_scale", "", ()
    cause = (
        "currents, another unit, or torques before the gear"
        if factor < 1.0
        else "another unit, or a load that the model does not have"
    )
    text = (
        f"torques are {factor:.3g} times what the nominal masses need, and so will be every identified "
        f"parameter: {cause}"
    )
    return mean_left(replace(samples, torque=samples.torque / factor)), "torque_scale", text, joints


def _motor_side(samples: TorqueSamples, log: Log) -> list[Finding]:
    """Torques called link-side that hold the rotors' inertia or the gears' friction.

    Rotors show at the outer joints, which carry little else.
    """
    if log.header.torque != "link_side":
        return []
    model, rotors, rubbing = samples.predicted(), [], []
    joints = log.header.torque_joints
    own = own_inertia(samples)
    for j, name in enumerate(joints):
        columns = np.column_stack([model[:, j], samples.drive_columns(j)])
        weights = scaled_fit(columns, samples.torque[:, j])
        torque = samples.torque[:, j] - samples.torque[:, j].mean()
        friction = columns[:, 2:4] @ weights[2:4]
        rotors.append(weights[4] / max(float(own[j]), 1e-12))
        if float(friction @ friction) > _DRIVE_SHARE * float(torque @ torque):
            rubbing.append(name)
    outer = float(np.median(rotors[-max(1, len(joints) // 2) :]))
    # Friction alone is seen behind the gear too, in bearings and seals; inertia that is negative is no rotor's.
    if outer < (0.0 if 2 * len(rubbing) > len(joints) else _ROTOR_SHARE):
        return []
    text = (
        "torques are called link_side, yet they hold rotor inertia "
        f"({outer:.2g} times the links' own at the outer joints) and friction ({len(rubbing)} joints): "
        "they look motor-side; write torque: motor_side, or these go into the links"
    )
    return [Finding("torque_side", text, {"rotor_share": outer, "joints": len(rubbing)}, tuple(joints))]
