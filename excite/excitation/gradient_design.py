"""Motions designed by gradients: splines added to a safe motion, for the information that those before lack.

Swevers et al. 1997 make motions rich by optimising their coefficients; Wilson and Murphey 2014 follow gradients of the
Fisher information; Ayusawa et al. 2017 take them analytically for several motions one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.optimize import minimize

from excite.arrays import Array
from excite.errors import InputError
from excite.excitation.optimisation.limits import JointLimits
from excite.excitation.optimisation.near_bodies import NearBodies, NearPairs
from excite.excitation.precision import row_noise
from excite.excitation.selection import Criterion
from excite.motion.motion import Motion, interpolate_motion
from excite.regressor.adjoint import RegressorGradient, regressor_gradient
from excite.regressor.base_parameters import BaseParameters, structural_base_parameters
from excite.regressor.columns import DRIVE_TERMS, measured_columns
from excite.regressor.kernels import forward_kinematics, joint_torque_regressor
from excite.regressor.tree import KinematicTree, read_tree
from excite.robot.joint_values import per_joint
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.threads import one_blas_thread

# Name of motions that are designed.
GRADIENT = "gradient"

_DEGREE = 4
# Samples a second that information is of.
SEARCH_HZ = 24.0


@dataclass(frozen=True)
class DesignSettings:
    """How motions are searched for; ``python -m benchmarks.minutes --settings`` changes one after the other.

    Attributes:
        knot_s: distance of the splines' knots [s].
        rate_hz: samples that limits and criterion are looked at [Hz].
        velocity: share of the velocities that is used at the samples: between them motions go beyond.
        acceleration: the same of the accelerations.
        near_m: bodies nearer than this beyond their margin are watched [m].
        extra_m: distance beyond the margin, for what happens between the samples [m].
        rounds: of the search, before each of which nearest points are found anew.
        iterations: in each round.
        growth: of the weight of squared violations from round to round, from 1.
    """

    knot_s: float = 0.25
    rate_hz: float = SEARCH_HZ
    velocity: float = 0.98
    acceleration: float = 0.94
    near_m: float = 0.06
    extra_m: float = 0.01
    rounds: int = 3
    iterations: int = 50
    growth: float = 5.0


_USUAL = DesignSettings()


class Pulled(NamedTuple):
    """Gradients of a criterion through the rows of an arm.

    Attributes:
        weights: of the regressor's entries ``(n, n_joints, size)``.
        v: through the drives' terms, in the velocities ``(n, n_joints)``.
        a: in the accelerations ``(n, n_joints)``.
    """

    weights: Array
    v: Array
    a: Array


@dataclass(frozen=True, eq=False)
class ArmRows:
    """The weighted regressor of an arm's base parameters, and the way back from its derivatives to the motion's.

    Attributes:
        robot: an arm whose joints all have motors.
    """

    robot: Robot

    def __post_init__(self) -> None:
        """Raise InputError for a robot without gradients."""
        if self.robot.floating or self.robot.mechanism is not None:
            raise InputError(
                "motions are designed by gradients for arms with a motor in every joint",
                source=self.robot.name,
                remedy="use another generator",
            )

    @cached_property
    def base(self) -> BaseParameters:
        """The base parameters, drives included."""
        return structural_base_parameters(self.robot, DRIVE_TERMS)

    @property
    def independent(self) -> NDArray[np.int64]:
        """Columns that stand for the base parameters, ``(n_base,)``."""
        return self.base.independent

    @cached_property
    def tree(self) -> KinematicTree:
        """The robot's, for compiled kernels."""
        return read_tree(self.robot.model)

    @cached_property
    def drives(self) -> Array:
        """Viscous and Coulomb friction and rotor inertia that the description states, ``(3, n_joints)`` [SI]."""
        drives, nothing = self.robot.description.drives, np.zeros(self.robot.n_joints)
        blocks = (drives.viscous, drives.coulomb, drives.armature)
        return np.array([per_joint(block, self.robot.joint_names, nothing) for block in blocks])

    def torques(self, full: Array, v: Array, a: Array, sign: Array) -> Array:
        """Torques of the drives, ``(n, n_joints)`` [N·m or N], of a joint torque regressor ``full``."""
        viscous, coulomb, armature = self.drives
        return np.asarray(full @ self.tree.phi + viscous * v + coulomb * sign + armature * a)

    @cached_property
    def _weights(self) -> Array:
        return 1.0 / row_noise(self.robot)

    @cached_property
    def _inertial(self) -> NDArray[np.int64]:
        return measured_columns(self.robot, DRIVE_TERMS).inertial

    def weighted(self, full: Array, v: Array, a: Array, sign: Array) -> Array:
        """Base columns over the noise, ``(n, n_joints, n_base)``, of a joint torque regressor ``full``."""
        n, n_joints = v.shape
        rows = np.zeros((n, n_joints, len(self._inertial) + 4 * n_joints))
        rows[:, :, : len(self._inertial)] = full[:, :, self._inertial]
        joints, first = np.arange(n_joints), len(self._inertial)
        for k, values in enumerate((v, sign, np.ones_like(v), a)):
            rows[:, joints, first + k * n_joints + joints] = values
        return rows[:, :, self.independent] * self._weights[:, None]

    def pulled(self, slope: Array, sign_slope: Array, size: int) -> Pulled:
        """Weights of the regressor's entries ``(n, n_joints, size)``, and what drives pull at v and a."""
        n, n_joints, _ = slope.shape
        whole = np.zeros((n, n_joints, len(self._inertial) + 4 * n_joints))
        whole[:, :, self.independent] = slope * self._weights[:, None]
        weights = np.zeros((n, n_joints, size))
        weights[:, :, self._inertial] = whole[:, :, : len(self._inertial)]
        joints, first = np.arange(n_joints), len(self._inertial)
        viscous, coulomb, _, armature = (whole[:, joints, first + k * n_joints + joints] for k in range(4))
        return Pulled(weights, viscous + coulomb * sign_slope, armature)

    def information(self, q: Array, v: Array, a: Array) -> Array:
        """Information of samples ``(n, n_joints)`` each, ``(n_base, n_base)``."""
        full = joint_torque_regressor(self.tree, q, v, a)
        rows = self.weighted(full, v, a, np.sign(v)).reshape(-1, len(self.independent))
        return np.asarray(rows.T @ rows)


@dataclass(frozen=True, eq=False)
class _Witnesses:
    """Points of pairs of bodies that come near each other, fixed to the bodies.

    Attributes:
        pairs: where they were found.
        joints: ``(m, 2)`` that carry them.
        points: ``(m, 2, 3)`` in the joints' frames [m].
    """

    pairs: NearPairs
    joints: NDArray[np.intp]
    points: Array


class DesignProgram:
    """A criterion of prior and own information less what violates the limits, in a spline's coefficients.

    Args:
        rows: of the arm.
        source: the safe motion that the spline is added to.
        prior: information so far, ``(n_base, n_base)``, of samples at the search's rate.
        criterion: what to make large.
        settings: of the search.
    """

    def __init__(
        self,
        rows: ArmRows,
        source: Motion,
        prior: Array,
        criterion: Criterion,
        settings: DesignSettings = _USUAL,
    ) -> None:
        # A copy that was sent to another process lies otherwise in memory, and sums of it would round otherwise.
        self._rows, self._prior, self._criterion = rows, np.ascontiguousarray(prior), criterion
        self.source, self._settings = source, settings
        self._limits = designed_limits(rows.robot, settings)
        robot, n_joints = rows.robot, rows.robot.n_joints
        n = max(4, round(source.duration / settings.knot_s))
        self._knots = np.r_[
            np.zeros(_DEGREE), np.linspace(0.0, source.duration, n + 1), np.full(_DEGREE, source.duration)
        ]
        time = np.linspace(0.0, source.duration, max(8, round(source.duration * settings.rate_hz)) + 1)
        self._bases, self._nominal = (
            self._basis(time),
            interpolate_motion(source, robot, source.time[0] + time),
        )
        # Jerks jump at knots of the source: they are looked at between the samples too.
        fine = np.linspace(0.0, source.duration, 8 * len(time))
        rates = np.diff(interpolate_motion(source, robot, source.time[0] + fine).a, axis=0) / fine[1]
        self._share = SEARCH_HZ / settings.rate_hz
        self._jerk, self._jerk_basis = rates, self._basis(fine[:-1] + 0.5 * fine[1])[3]
        self._most_jerk = robot.limits.jerk
        self.size = self._bases[0].shape[1] * n_joints
        self._tree = rows.tree
        self._half = 0.5 * (self._limits.upper - self._limits.lower)
        self._bodies = NearBodies(robot, np.arange(1, n_joints + 1))
        self._near: _Witnesses | None = None

    def _basis(self, time: Array) -> tuple[Array, ...]:
        """The splines and their first three derivatives, ``(n, k)`` each; those left out would move the ends."""
        count = len(self._knots) - _DEGREE - 1
        spline = BSpline(self._knots, np.eye(count), _DEGREE)
        inside = np.clip(time, 0.0, self._knots[-1] * (1.0 - 1e-12))
        values = ((spline.derivative(d) if d else spline)(inside)[:, 3:-3] for d in range(4))
        return tuple(np.ascontiguousarray(basis) for basis in values)

    def _table(self, x: Array) -> Array:
        """Coefficients of the splines, ``(k, n_joints)``."""
        return self._settings.knot_s * x.reshape(-1, self._rows.robot.n_joints)

    def states(self, x: Array) -> tuple[Array, ...]:
        """q, v, a ``(n, n_joints)`` of coefficients ``(size,)``."""
        table, own = self._table(x), self._nominal
        whole = (s + b @ table for s, b in zip((own.q, own.v, own.a), self._bases, strict=False))
        return tuple(np.ascontiguousarray(values) for values in whole)

    def information(self, x: Array) -> Array:
        """Information of the motion alone."""
        return self._share * self._rows.information(*self.states(x))

    def motion(self, x: Array) -> Motion:
        """The source with the splines added."""
        source, table = self.source, self._table(x)
        bases = self._basis(source.time - source.time[0])
        q, v, a = (s + b @ table for s, b in zip((source.q, source.v, source.a), bases, strict=False))
        metadata = replace(source.metadata, generator=GRADIENT, verdict=None)
        return replace(source, q=q, v=v, a=a, metadata=metadata)

    def evaluate(self, x: Array, weight: float) -> tuple[float, Array]:
        """What is minimised, and its gradient ``(size,)``; ``weight`` is that of squared violations."""
        q, v, a = self.states(x)
        width = 0.02 * self._limits.velocity
        sign = np.tanh(v / width)
        full = joint_torque_regressor(self._tree, q, v, a)
        rows = self._rows.weighted(full, v, a, sign)
        flat = rows.reshape(-1, rows.shape[2])
        information = self._prior + self._share * (flat.T @ flat)
        value = -self._criterion.value(information)
        slope = -2.0 * self._share * (flat @ self._criterion.gradient(information)).reshape(rows.shape)
        weights, by_v, by_a = self._rows.pulled(slope, (1.0 - sign**2) / width, full.shape[2])
        by_q = np.zeros_like(q)
        torque = self._rows.torques(full, v, a, sign)
        viscous, coulomb, armature = self._rows.drives
        middle = self._limits.lower + self._half
        penalty, parts = 0.0, []
        jerk = self._jerk + self._jerk_basis @ self._table(x)
        for values, limit in (
            (q - middle, self._half),
            (v, self._limits.velocity),
            (a, self._limits.acceleration),
            (torque, self._limits.torque),
            (jerk, 0.9 * self._most_jerk),
        ):
            over = 10.0 * np.maximum(np.abs(values) / limit - 0.99, 0.0)
            penalty += float((over**2).sum())
            parts.append(20.0 * weight * over * np.sign(values) / limit)
        by_q += parts[0]
        by_v += parts[1] + parts[3] * (viscous + coulomb * (1.0 - sign**2) / width)
        by_a += parts[2] + parts[3] * armature
        weights += parts[3][:, :, None] * self._tree.phi
        penalty += self._push_apart(q, weight, by_q)
        gradient: RegressorGradient = regressor_gradient(self._tree, q, v, a, weights)
        pulls = (gradient.q + by_q, gradient.v + by_v, gradient.a + by_a)
        found = sum(basis.T @ pull for basis, pull in zip(self._bases, pulls, strict=False))
        found = found + self._jerk_basis.T @ parts[4]
        return value + weight * penalty, self._settings.knot_s * np.asarray(found).ravel()

    def watch(self, x: Array) -> None:
        """Find the nearest points of bodies that are near each other."""
        poses, pairs = self._bodies.find(self.states(x)[0], self._bodies.kept + self._settings.near_m)
        joints, at = self._bodies.carriers(pairs), pairs.sample[:, None]
        world = np.stack([pairs.first, pairs.second], axis=1)
        local = np.einsum("mkji,mkj->mki", poses.rotation[at, joints], world - poses.translation[at, joints])
        self._near = _Witnesses(pairs, joints, local)

    def _push_apart(self, q: Array, weight: float, by_q: Array) -> float:
        """Squared lack of distance in centimetres; its gradient is added to ``by_q``."""
        if self._near is None:
            return 0.0
        near, poses = self._near, forward_kinematics(self._tree, q)
        at = near.pairs.sample[:, None]
        turned = np.einsum("mkij,mkj->mki", poses.rotation[at, near.joints], near.points)
        first, second = (turned + poses.translation[at, near.joints]).transpose(1, 0, 2)
        apart = ((second - first) * near.pairs.normal).sum(axis=1)
        lack = np.maximum(self._bodies.kept[near.pairs.pair] + self._settings.extra_m - apart, 0.0) / 0.01
        slope = self._bodies.slopes(poses, replace(near.pairs, first=first, second=second))
        np.add.at(by_q, near.pairs.sample, (-2.0 * weight * lack / 0.01)[:, None] * slope)
        return float((lack**2).sum())


def designed_limits(robot: Robot, settings: DesignSettings) -> JointLimits:
    """What designs keep at the search's samples: all that the check allows, but for what happens between them."""
    own = robot.limits
    return JointLimits(
        lower=own.position_lower,
        upper=own.position_upper,
        velocity=settings.velocity * own.velocity,
        acceleration=settings.acceleration * own.acceleration,
        torque=own.torque,
    )


@dataclass(frozen=True, eq=False)
class Design:
    """A motion that was designed.

    Attributes:
        motion: the motion, which the check finds safe.
        information: of the motion alone, ``(n_base, n_base)``.
        step: part of the way to the optimum that the check finds safe; 0 where the motion is its source still.
    """

    motion: Motion
    information: Array
    step: float


@one_blas_thread
def design_motion(
    rows: ArmRows,
    source: Motion,
    prior: Array,
    criterion: Criterion,
    *,
    robust: bool = False,
    settings: DesignSettings = _USUAL,
) -> Design:
    """The motion near a safe one that adds most to the information so far.

    Coefficients are those of B-splines of degree four that leave both ends at rest. Squared violations of the limits
    and of distances at coal's witness points are penalties of growing weight; L-BFGS-B minimises. The step is then
    shortened until the independent check finds the motion safe; with none left it is the source itself.

    Args:
        rows: of the arm.
        source: a safe motion.
        prior: ``(n_base, n_base)`` information so far, positive definite.
        criterion: what to make large.
        robust: whether the check asks for safety of all robots of the set that the description states.
        settings: of the search.
    """
    program = DesignProgram(rows, source, prior, criterion, settings)
    x = np.zeros(program.size)
    for k in range(settings.rounds):
        program.watch(x)
        found = minimize(
            program.evaluate, x, args=(settings.growth**k,), jac=True, method="L-BFGS-B",
            bounds=np.stack([x - 2.0, x + 2.0], axis=1), options={"maxiter": settings.iterations, "maxcor": 15},
        )  # fmt: skip
        x = np.asarray(found.x)
    # Each time twice as much is taken off the step.
    for step in (1.0, *(1.0 - 0.01 * 2**k for k in range(7))):
        motion = program.motion(step * x)
        if _is_safe(rows.robot, motion, robust=robust):
            return Design(motion, program.information(step * x), step)
    return Design(source, program.information(0.0 * x), 0.0)


def design_motions(
    rows: ArmRows,
    sources: Sequence[Motion],
    start: Array,
    criterion: Criterion,
    *,
    robust: bool = False,
    settings: DesignSettings = _USUAL,
) -> list[Design]:
    """Designs of motions that are run together, each for what those before it lack.

    Args:
        rows: of the arm.
        sources: safe motions.
        start: ``(n_base, n_base)`` information to begin with, positive definite.
        criterion: what to make large.
        robust: as of :func:`design_motion`.
        settings: of the search.
    """
    made: list[Design] = []
    information = start
    for source in sources:
        made.append(design_motion(rows, source, information, criterion, robust=robust, settings=settings))
        information = information + made[-1].information
    return made


def _is_safe(robot: Robot, motion: Motion, *, robust: bool) -> bool:
    return check_motion(robot, motion, robust=robust).safe


@one_blas_thread
def first_information(rows: ArmRows, sources: Sequence[Motion]) -> Array:
    """A hundredth of what all sources say, which makes every determinant finite, ``(n_base, n_base)``."""
    total = np.zeros((len(rows.independent), len(rows.independent)))
    for motion in sources:
        sampled = motion.resampled(rows.robot, SEARCH_HZ)
        total += rows.information(sampled.q, sampled.v, sampled.a)
    return 0.01 * total / len(sources) + 1e-9 * np.diag(np.diag(total))
