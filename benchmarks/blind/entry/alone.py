"""The plainest entry: fit each effect alone beside the modelled terms, and name the one with the lowest BIC."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import LogError
from excite.logs.files import load_log
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot
from excite.regressor.kernels import inverse_dynamics, joint_torque_regressor
from excite.robot.robot import Robot
from excite.rows.kinematics import TrialRows, filtered_rows, forces_on_grid, trial_kinematics
from excite.rows.settings import ProblemSettings

# The band in which true shares are computed.
_CUTOFF_HZ = 10.0
# A joint that is slower than this [rad/s] stands: its friction may be anything.
_STILL = 0.02


@dataclass(frozen=True, eq=False)
class _Named:
    """Columns of one candidate among all of the rows."""

    effect: str
    location: str
    columns: slice
    more: int


@dataclass(frozen=True, eq=False)
class _Rows:
    """Equations of some trials: modelled terms, candidates, then the torque that the given bodies leave."""

    values: Array
    use: NDArray[np.bool_]


def fitted_alone(folder: Path) -> dict[str, Any]:
    """Answer (``excite.blind_answer/1``) to one case.

    The terms that the log calls modelled are fitted to the identification trials with each effect in turn, each joint
    weighted by what the modelled terms leave of it; BIC is ``Σ n_j log(rss_j/n_j) + k log n`` over the joints
    (Schwarz 1978). The share of an effect is what it takes off the mean square of the validation trials.

    Args:
        folder: of the log.

    Returns:
        The answer; nothing is named where no effect has a lower BIC than none.

    Raises:
        LogError: no log of an arm with torques.
    """
    log = arm_log(folder)
    settings = ProblemSettings(cutoff_hz=_CUTOFF_HZ, drive_terms=())
    parts = [(trial, _trial_equations(log, trial, settings)) for trial in log.log.trials]
    named, n_modelled = parts[0][1].named, parts[0][1].n_modelled
    learn, judge = (
        _join_rows(
            [equations.rows for trial, equations in parts if (trial.role == "validation") is validation]
        )
        for validation in (False, True)
    )
    weight = np.ones(learn.values.shape[1])
    for _ in range(2):
        bare = _fit_columns(learn, n_modelled, slice(0, 0), weight)
        weight = 1.0 / np.maximum(np.sqrt(_mean_square(learn, n_modelled, slice(0, 0), bare)), 1e-9)
    count = learn.use.sum(axis=0)

    def bic(columns: slice, fit: Array, more: int) -> float:
        left = np.maximum(_mean_square(learn, n_modelled, columns, fit), 1e-18)
        price = (columns.stop - columns.start + more) * np.log(count.sum())
        return float((count * np.log(left)).sum() + price)

    least, best = bic(slice(0, 0), bare, 0), None
    for item in named:
        fit = _fit_columns(learn, n_modelled, item.columns, weight)
        score = bic(item.columns, fit, item.more)
        if score < least:
            least, best = score, (item, fit)
    effects = []
    if best is not None:
        item, fit = best
        before = _mean_square(judge, n_modelled, slice(0, 0), bare)
        after = _mean_square(judge, n_modelled, item.columns, fit)
        for joint, b, a in zip(log.robot.joint_names, before, after, strict=True):
            share = float(1.0 - a / b) if b > 0.0 else 0.0
            effects.append(
                {"effect": item.effect, "location": item.location, "channel": joint, "share": share}
            )
    program = "each effect alone, lowest BIC"
    return {"schema": "excite.blind_answer/1", "program": program, "effects": effects}


class _Equations(NamedTuple):
    """A trial's rows, columns of effects that may be named, and how many of what is modelled stand before them."""

    rows: TrialRows
    named: list[_Named]
    n_modelled: int


def _trial_equations(log: ArmLog, trial: Trial, settings: ProblemSettings) -> _Equations:
    filters = settings.filters(floating=False)
    k = trial_kinematics(log.robot, log.log.header, trial, settings, filters)
    session = k.time - k.time[0] + (trial.start_s or 0.0)
    s = Samples(log.robot, log.fixed, session, k.rate_hz, k.q, k.v, k.a)
    known = modelled_columns(s, log.modelled)
    parts, named, at = [known], [], known.shape[2]
    for item in single_effects(s, log.modelled):
        width = item.columns.shape[2]
        named.append(_Named(item.effect, item.location, slice(at, at + width), item.more))
        parts.append(item.columns)
        at += width
    torque = forces_on_grid(trial.time, log.torque(trial), k.time) - log.given(k.q, k.v, k.a)
    values = np.concatenate([*parts, torque[:, :, None]], axis=2)
    moving = np.abs(k.v) > _STILL
    rows = filtered_rows(lambda part: values[part], k, filters, k.valid[:, None] & moving)
    return _Equations(rows, named, known.shape[2])


def _join_rows(rows: list[TrialRows]) -> _Rows:
    return _Rows(np.concatenate([r.values for r in rows]), np.concatenate([r.use for r in rows]))


def _modelled_columns(rows: _Rows, n_modelled: int, columns: slice) -> Array:
    return np.concatenate([rows.values[:, :, :n_modelled], rows.values[:, :, columns]], axis=2)


def _fit_columns(rows: _Rows, n_modelled: int, columns: slice, weight: Array) -> Array:
    """Least squares of the modelled terms and one candidate, ``(n_modelled + k,)``."""
    a = _modelled_columns(rows, n_modelled, columns) * (weight * rows.use)[:, :, None]
    b = rows.values[:, :, -1] * weight * rows.use
    a, b = a.reshape(-1, a.shape[2]), b.ravel()
    scale = np.maximum(np.linalg.norm(a, axis=0), 1e-12)
    a = a / scale
    # Normal equations: a sum of squares to one part in 1e8 is enough to compare, and there are hundreds of fits.
    gram = a.T @ a
    values, vectors = np.linalg.eigh(gram)
    keep = values > 1e-9 * max(float(values[-1]), 1e-12)
    solved = vectors[:, keep] @ ((vectors[:, keep].T @ (a.T @ b)) / values[keep])
    return np.asarray(solved / scale)


def _mean_square(rows: _Rows, n_modelled: int, columns: slice, fit: Array) -> Array:
    """Mean square of what a fit leaves of each joint, ``(n_joints,)`` [N²·m²]."""
    rest = (rows.values[:, :, -1] - _modelled_columns(rows, n_modelled, columns) @ fit) * rows.use
    return np.asarray((rest**2).sum(axis=0) / np.maximum(rows.use.sum(axis=0), 1))


# Columns of the joint torque equation for single effects in their textbook forms, each linear in its size.

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


# The log of a blind case as the plain entries take it: an arm with a torque of every joint.


@dataclass(frozen=True, eq=False)
class ArmLog:
    """A log and its nominal robot.

    Attributes:
        log: the log.
        robot: the nominal robot, its joints in the log's order.
    """

    log: Log
    robot: Robot

    @property
    def modelled(self) -> tuple[str, ...]:
        """What the log calls modelled."""
        return tuple(self.log.header.modelled)

    @property
    def fixed(self) -> bool:
        """Whether inertial parameters are given."""
        return "rigid_body_fixed" in self.modelled

    def torque(self, trial: Trial) -> Array:
        """Torques of a trial ``(n, n_joints)`` [N·m]; raises LogError where it has none."""
        if trial.tau is None:
            raise LogError("has no torques", source=trial.name, remedy="log tau.* of every joint")
        return trial.tau

    def given(self, q: Array, v: Array, a: Array) -> Array:
        """Torques of the nominal bodies ``(n, n_joints)`` [N·m]."""
        return inverse_dynamics(self.robot.model, q, v, a)


def arm_log(folder: Path) -> ArmLog:
    """Read a case.

    Args:
        folder: of the log.

    Raises:
        LogError: it is no log, or none of an arm with a torque of every joint.
    """
    log = load_log(folder)
    robot = nominal_robot(log)
    measured = log.header.torque in {"motor_side", "link_side"}
    if robot.floating or not measured or tuple(log.header.torque_joints) != tuple(robot.joint_names):
        remedy = "this entry takes arms with a torque of every joint"
        raise LogError("is no log of such an arm", source=folder, field="torque", remedy=remedy)
    return ArmLog(log, robot)
