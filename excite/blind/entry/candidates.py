"""Columns of the joint torque equation for single effects in their textbook forms, each linear in its size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.regressor.kernels import inverse_dynamics, joint_torque_regressor
from excite.robot.robot import Robot

_STEP = 1e-5
# Speed over which dry friction changes its sign [rad/s].
_SIGN_WIDTH = 5e-3
# Forms that a column cannot be fitted to are tried one by one.
_STRIBECK_SPEEDS = (0.03, 0.06, 0.12)
_RIPPLE_PERIODS = range(8, 45)
_WARMING_S = 60.0

OWN_TERMS = ("viscous_friction", "coulomb_friction", "armature")


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of one trial.

    Attributes:
        robot: the nominal robot.
        fixed: whether its inertial parameters are given.
        session: ``(n,)`` time since the session began [s].
        rate_hz: of the samples.
        q: ``(n, nq)`` [rad or m].
        v: ``(n, nv)``.
        a: ``(n, nv)``.
    """

    robot: Robot
    fixed: bool
    session: Array
    rate_hz: float
    q: Array
    v: Array
    a: Array


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect at a place.

    Attributes:
        effect: its name.
        location: its place.
        columns: ``(n, n_joints, k)`` what its sizes are multiplied by.
        more: parameters that are chosen and not fitted, which a criterion counts as well.
    """

    effect: str
    location: str
    columns: Array
    more: int = 0


def modelled_columns(s: Samples, modelled: tuple[str, ...]) -> Array:
    """Columns of the terms that the log calls modelled, ``(n, n_joints, k)``."""
    n = s.robot.n_joints
    terms = dict(zip(OWN_TERMS, (s.v, _velocity_sign(s.v), s.a), strict=True))
    parts = [terms[name][:, :, None] * np.eye(n) for name in OWN_TERMS if name in modelled]
    if not s.fixed:
        parts.append(joint_torque_regressor(s.robot.model, s.q, s.v, s.a))
    return np.concatenate([np.zeros((len(s.q), n, 0)), *parts], axis=2)


def single_effects(s: Samples, modelled: tuple[str, ...]) -> Iterator[Candidate]:
    """All single effects, in an order that depends on the robot and ``modelled`` only."""
    model, names = s.robot.model, s.robot.joint_names
    load = inverse_dynamics(model, s.q, s.v, s.a)
    for j, name in enumerate(names):
        for effect, column in zip(OWN_TERMS, (s.v, _velocity_sign(s.v), s.a), strict=True):
            if effect not in modelled:
                yield Candidate(effect, name, _own_columns_of(s, j, column[:, j]))
        yield from _in_joint(s, j, name, load[:, j])
        yield from _deflection_candidates(s, j, name, load[:, j])
    yield Candidate("time_delay", "torque", np.gradient(load, 1.0 / s.rate_hz, axis=0)[:, :, None])
    yield Candidate("base_tilt", "base", _tilt_columns(s, load))
    if s.fixed:
        yield from _body_candidates(s, load)


def _velocity_sign(v: Array) -> Array:
    return np.tanh(v / _SIGN_WIDTH)


def _own_columns_of(s: Samples, joint: int, *columns: Array) -> Array:
    made = np.zeros((len(s.q), s.robot.n_joints, len(columns)))
    made[:, joint] = np.stack(columns, axis=1)
    return made


def _in_joint(s: Samples, j: int, name: str, load: Array) -> Iterator[Candidate]:
    """Effects that act on the row of their own joint."""
    q, v = s.q[:, j], s.v[:, j]
    sign, one = _velocity_sign(v), np.ones(len(v))
    yield Candidate("torque_bias", name, _own_columns_of(s, j, one))
    yield Candidate("torque_gain", name, _own_columns_of(s, j, load))
    yield Candidate("joint_spring", name, _own_columns_of(s, j, q, one))
    yield Candidate("load_dependent_friction", name, _own_columns_of(s, j, sign * np.abs(load)))
    yield Candidate("friction_drift", name, _own_columns_of(s, j, sign * -np.expm1(-s.session / _WARMING_S)))
    for speed in _STRIBECK_SPEEDS:
        yield Candidate("stribeck", name, _own_columns_of(s, j, sign * np.exp(-((v / speed) ** 2))), more=1)
    for periods in _RIPPLE_PERIODS:
        wave = (np.cos(periods * q), np.sin(periods * q))
        yield Candidate("torque_ripple", name, _own_columns_of(s, j, *wave), more=1)


def _deflection_candidates(s: Samples, j: int, name: str, load: Array) -> Iterator[Candidate]:
    """Effects that turn the link away from where the encoder says: they act on the rows of all joints."""
    model, e = s.robot.model, np.eye(s.robot.n_joints)[j] * _STEP
    by_q = inverse_dynamics(model, s.q + e, s.v, s.a) - inverse_dynamics(model, s.q - e, s.v, s.a)
    by_v = inverse_dynamics(model, s.q, s.v + e, s.a) - inverse_dynamics(model, s.q, s.v - e, s.a)
    by_a = inverse_dynamics(model, s.q, s.v, s.a + e) - inverse_dynamics(model, s.q, s.v, s.a - e)
    if s.fixed:
        yield Candidate("encoder_offset", name, by_q[:, :, None] / (2.0 * _STEP))
    edge = 0.05 * float(load.std()) + 1e-12
    for effect, bent in (("joint_elasticity", load), ("backlash", np.tanh(load / edge))):
        rate = np.gradient(bent, 1.0 / s.rate_hz)
        jerk = np.gradient(rate, 1.0 / s.rate_hz)
        moved = by_q * bent[:, None] + by_v * rate[:, None] + by_a * jerk[:, None]
        yield Candidate(effect, name, moved[:, :, None] / (2.0 * _STEP))


def _tilt_columns(s: Samples, load: Array) -> Array:
    """What gravity makes more of when the base leans about either horizontal axis."""
    made = []
    for axis in range(2):
        leaning: pin.Model = s.robot.model.copy()
        gravity = leaning.gravity.linear.copy()
        gravity[axis] += 1.0
        leaning.gravity.linear = gravity
        made.append(inverse_dynamics(leaning, s.q, s.v, s.a) - load)
    return np.stack(made, axis=2)


def _body_candidates(s: Samples, load: Array) -> Iterator[Candidate]:
    """Bodies that are heavier than given, or elsewhere."""
    model = s.robot.model
    regressor = joint_torque_regressor(model, s.q, s.v, s.a)
    for k, segment in enumerate(s.robot.segments):
        ten = regressor[:, :, 10 * k : 10 * (k + 1)]
        own = ten @ model.inertias[k + 1].toDynamicParameters()
        yield Candidate("link_inertia", segment.link, own[:, :, None])
        yield Candidate("payload", segment.link, ten)
    for j, name in enumerate(s.robot.joint_names):
        columns = []
        for axis in range(3):
            moved = model.copy()
            placement = moved.jointPlacements[j + 1].copy()
            placement.translation = placement.translation + _STEP * np.eye(3)[axis]
            moved.jointPlacements[j + 1] = placement
            columns.append((inverse_dynamics(moved, s.q, s.v, s.a) - load) / _STEP)
        yield Candidate("link_length_error", name, np.stack(columns, axis=2))
