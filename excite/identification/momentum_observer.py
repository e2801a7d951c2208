"""Generalised-momentum observer: which external torque the joint torques betray (collision detection).

De Luca, Albu-Schäffer, Haddadin, Hirzinger, IROS 2006, with the parameters that identification found;
Xu et al., IEEE Access 2020, compare parameter sets by its largest residual (Table 10).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.errors import InputError, LogError
from excite.logs.log import Log, Trial
from excite.logs.robot import robot_in_log
from excite.regressor.kernels import inverse_dynamics
from excite.regressor.tree import read_tree
from excite.robot.robot import Robot
from excite.rows.drive_terms import DRIVE_TERMS, JointSamples
from excite.rows.kinematics import forces_on_grid, trial_kinematics
from excite.rows.settings import ProblemSettings

DEFAULT_GAIN = 25.0
# Half step of the derivative of the mass matrix [s]; its error is that of rounding, 1e-11 of the momentum.
_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class MomentumResidual:
    """Residual of the observer over a trial.

    Attributes:
        time: ``(n,)`` [s].
        joints: names of the joints.
        residual: ``(n, n_joints)`` estimate of the external joint torque, delayed by about ``1/gain`` [N·m].
        gain: of the observer [1/s], its bandwidth.
    """

    time: Array
    joints: tuple[str, ...]
    residual: Array
    gain: float

    def largest(self) -> dict[str, float]:
        """Largest size of each joint's residual [N·m]: a threshold above it raises no false alarm here."""
        sizes = np.abs(self.residual).max(axis=0, initial=0.0)
        return dict(zip(self.joints, sizes.tolist(), strict=True))

    def summary(self) -> str:
        """One line a joint."""
        return "\n".join(
            f"{joint}: largest residual {size:.4g} N·m" for joint, size in self.largest().items()
        )


@dataclass(frozen=True, eq=False)
class MomentumTerms:
    """Terms of ``ṗ = τ + Cᵀv − g``.

    Attributes:
        momentum: ``p = M v``, ``(n, nv)`` [N·m·s].
        rate: ``Cᵀv − g``, ``(n, nv)`` [N·m].
    """

    momentum: Array
    rate: Array


def momentum_residual(
    robot: Robot,
    log: Log,
    trial: Trial,
    parameters: Array,
    *,
    drives: dict[str, float] | None = None,
    gain: float = DEFAULT_GAIN,
    settings: ProblemSettings | None = None,
) -> MomentumResidual:
    """The observer's residual over a trial of a log, its ends left out, where the filter has yet to settle.

    Args:
        robot: the robot; a log of a floating or hanging base is refused.
        log: the log that the trial is from.
        trial: the trial, with joint torques.
        parameters: ``(10·n_segments,)`` inertial parameters [SI], ``Identification.parameters`` for example.
        drives: the drives' parameters by name, ``viscous.joint1`` and so on; none by default.
        gain: of the observer, for every joint [1/s].
        settings: filters of the positions and width of Coulomb friction; defaults if None.

    Returns:
        The residual of each joint over the trial.

    Raises:
        LogError: the log is of a floating base, or has no torques.
        InputError: wrong shapes, a gain that is not positive, or an unknown drive parameter.
    """
    settings = settings or ProblemSettings()
    if log.header.base == "floating" or robot.floating:
        raise LogError(
            "is of a floating base",
            source=log.folder,
            field="base",
            remedy="the observer needs the torques of all degrees of freedom",
        )
    if trial.tau is None:
        raise LogError("has no torques", source=trial.name, field="tau", remedy="log tau.* in N·m")
    robot = robot_in_log(robot, log.header, log.folder)
    if log.header.torque_joints != robot.joint_names:
        raise LogError(
            "does not hold every joint", source=trial.name, field="joints", remedy="log all of " + robot.name
        )
    k = trial_kinematics(robot, log.header, trial, settings, settings.filters(floating=False))
    joints = list(range(robot.n_joints))
    samples = JointSamples(robot, k.q, k.v, k.a, joints, settings.coulomb_width)
    torque = forces_on_grid(trial.time, trial.tau, k.time) - drive_torques(samples, drives or {})
    inside = np.flatnonzero(k.valid)
    if len(inside) < 2:
        raise LogError("is shorter than its filter needs", source=trial.name, remedy="record longer")
    part = slice(int(inside[0]), int(inside[-1]) + 1)
    return observe_momentum(robot, k.time[part], k.q[part], k.v[part], torque[part], parameters, gain=gain)


def observe_momentum(
    robot: Robot, time: Array, q: Array, v: Array, torque: Array, parameters: Array, *, gain: float
) -> MomentumResidual:
    """The observer on samples: ``r = K (p − ∫(τ + Cᵀv − g + r) dt − p(0))`` with ``p = M v``.

    Without friction in ``torque`` and with true parameters, ``r`` follows the external torque through a first
    order lag, ``ṙ = K (τ_ext − r)``. Integrals by the trapezoidal rule.

    Args:
        robot: an arm.
        time: ``(n,)`` increasing [s].
        q: ``(n, nq)``.
        v: ``(n, nv)``.
        torque: ``(n, nv)`` joint torques without friction [N·m].
        parameters: ``(10·n_segments,)`` [SI].
        gain: [1/s].

    Raises:
        InputError: wrong shapes, time that does not increase, or a gain that is not positive.
    """
    if not (np.isfinite(gain) and gain > 0.0):
        raise InputError(
            f"is {gain!r}", source="settings", field="gain", remedy="choose a positive one [1/s]"
        )
    shape = (len(time), robot.model.nv)
    if q.shape != (len(time), robot.model.nq) or v.shape != shape or torque.shape != shape:
        raise InputError(f"samples of shapes {q.shape}, {v.shape}, {torque.shape} for {len(time)} instants")
    step = np.diff(time)
    if (step <= 0.0).any():
        raise InputError(
            "does not increase", source="samples", field="time", remedy="sort and drop repeated samples"
        )
    terms = momentum_and_rate(robot, q, v, parameters)
    rate = terms.rate + torque
    gained = 0.5 * step[:, None] * (rate[1:] + rate[:-1])
    change = np.diff(terms.momentum, axis=0) - gained
    residual = np.zeros(shape)
    half = 0.5 * gain * step
    for k in range(len(step)):
        residual[k + 1] = ((1.0 - half[k]) * residual[k] + gain * change[k]) / (1.0 + half[k])
    return MomentumResidual(time, robot.joint_names, residual, gain)


def drive_torques(samples: JointSamples, drives: dict[str, float]) -> Array:
    """Torque that the drives' terms take, ``(n, n_joints)`` [N·m].

    Raises:
        InputError: a parameter that is of no term or joint.
    """
    names = samples.robot.joint_names
    total, left = np.zeros((len(samples.q), len(names))), dict(drives)
    for term in DRIVE_TERMS.values():
        own = term.parameter_names(names)
        if not any(name in left for name in own):
            continue
        values = np.array([left.pop(name, 0.0) for name in own])
        total += term.columns(samples) @ values
    if left:
        raise InputError("is no drive parameter of the robot", field=next(iter(left)))
    return total


def momentum_and_rate(robot: Robot, q: Array, v: Array, parameters: Array) -> MomentumTerms:
    """What the observer needs of the dynamics, for any parameters, consistent bodies or not.

    ``Cᵀv = Ṁv − Cv``, with ``Ṁv`` the derivative of ``M(q)v`` along ``v`` by central differences.

    Args:
        robot: an arm.
        q: ``(n, nq)``.
        v: ``(n, nv)``.
        parameters: ``(10·n_segments,)`` [SI].
    """
    tree, still = read_tree(robot.model), np.zeros_like(v)

    def momentum(at: Array) -> Array:
        weight = inverse_dynamics(tree, at, still, still, parameters)
        return inverse_dynamics(tree, at, still, v, parameters) - weight

    gravity = inverse_dynamics(tree, q, still, still, parameters)
    coriolis = inverse_dynamics(tree, q, v, still, parameters) - gravity
    change = (momentum(q + _STEP * v) - momentum(q - _STEP * v)) / (2.0 * _STEP)
    return MomentumTerms(momentum(q), change - coriolis - gravity)
