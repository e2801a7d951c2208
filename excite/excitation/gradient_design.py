"""Motions designed by gradients: splines added to a safe motion, for the information that those before lack.

Swevers et al. 1997 make motions rich by optimising their coefficients; Wilson and Murphey 2014 follow gradients of the
Fisher information; Ayusawa et al. 2017 take them analytically for several motions one after the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.optimize import minimize

from excite.arrays import Array
from excite.excitation.design_rows import DesignRows
from excite.excitation.near_bodies import NearBodies, NearPairs
from excite.excitation.selection import Criterion
from excite.motion.motion import Motion, interpolate_motion
from excite.regressor.adjoint import RegressorGradient, regressor_gradient
from excite.regressor.kernels import forward_kinematics
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.parameter_set import stated_parameters
from excite.threads import one_blas_thread

# Name of motions that are designed.
GRADIENT = "gradient"

_DEGREE = 4
# Samples a second that limits, criterion and information are of.
SEARCH_HZ = 24.0
# Distance of the splines' knots [s].
_KNOT_S = 0.25
# Shares of velocities and accelerations that are used at the samples: between them motions go beyond.
_VELOCITY, _ACCELERATION = 0.98, 0.94
# Bodies nearer than this beyond their margin are watched, and the distance beyond it that they keep, for what happens
# between the samples [m].
_NEAR_M, _EXTRA_M = 0.06, 0.01
# Rounds of the search, before each of which nearest points are found anew; at most as many more while no step is safe:
# what little is known pulls harder than the first weights. Iterations in each.
_ROUNDS, _MORE_ROUNDS, _ITERATIONS = 3, 2, 50


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
        rows: of the robot.
        source: the safe motion that the spline is added to.
        prior: information so far, ``(n_base, n_base)``, of samples at the search's rate.
        criterion: what to make large.
    """

    def __init__(self, rows: DesignRows, source: Motion, prior: Array, criterion: Criterion) -> None:
        # A copy that was sent to another process lies otherwise in memory, and sums of it would round otherwise.
        self._rows, self._prior, self._criterion = rows, np.ascontiguousarray(prior), criterion
        self.source = source
        robot, moved = rows.robot, rows.moved
        own = robot.limits
        self._velocity = _VELOCITY * own.velocity[moved]
        self._acceleration = _ACCELERATION * own.acceleration[moved]
        self._at_q, self._at_v = robot.n_base_q + moved, robot.n_base_v + moved
        n = max(4, round(source.duration / _KNOT_S))
        self._knots = np.r_[
            np.zeros(_DEGREE), np.linspace(0.0, source.duration, n + 1), np.full(_DEGREE, source.duration)
        ]
        time = np.linspace(0.0, source.duration, max(8, round(source.duration * SEARCH_HZ)) + 1)
        self._bases, self._nominal = (
            self._basis(time),
            interpolate_motion(source, robot, source.time[0] + time),
        )
        # Jerks jump at knots of the source: they are looked at between the samples too.
        fine = np.linspace(0.0, source.duration, 8 * len(time))
        between = interpolate_motion(source, robot, source.time[0] + fine).a[:, self._at_v]
        rates = np.diff(between, axis=0) / fine[1]
        self._jerk, self._jerk_basis = rates, self._basis(fine[:-1] + 0.5 * fine[1])[3]
        self._most_jerk = own.jerk[moved]
        self.size = self._bases[0].shape[1] * len(moved)
        self._tree = rows.tree
        self._half = 0.5 * (own.position_upper - own.position_lower)[moved]
        self._middle = own.position_lower[moved] + self._half
        self._bodies = NearBodies(robot, moved + (2 if robot.floating else 1))
        self._burden = rows.burden(self._nominal)
        self._near: _Witnesses | None = None

    def _basis(self, time: Array) -> tuple[Array, ...]:
        """The splines and their first three derivatives, ``(n, k)`` each; those left out would move the ends."""
        count = len(self._knots) - _DEGREE - 1
        spline = BSpline(self._knots, np.eye(count), _DEGREE)
        inside = np.clip(time, 0.0, self._knots[-1] * (1.0 - 1e-12))
        values = ((spline.derivative(d) if d else spline)(inside)[:, 3:-3] for d in range(4))
        return tuple(np.ascontiguousarray(basis) for basis in values)

    def _table(self, x: Array) -> Array:
        """Coefficients of the splines, ``(k, n_moved)``."""
        return _KNOT_S * x.reshape(-1, len(self._at_q))

    def states(self, x: Array) -> tuple[Array, ...]:
        """q ``(n, nq)``, v and a ``(n, nv)`` of coefficients ``(size,)``."""
        return self._added(self._nominal, self._bases, x)

    def _added(self, motion: Motion, bases: tuple[Array, ...], x: Array) -> tuple[Array, ...]:
        """The splines added to a motion's q, v and a."""
        table, found = self._table(x), []
        ways = ((motion.q, self._at_q), (motion.v, self._at_v), (motion.a, self._at_v))
        for (values, at), basis in zip(ways, bases, strict=False):
            found.append(np.array(values, order="C"))
            found[-1][:, at] += basis @ table
        return tuple(found)

    def information(self, x: Array) -> Array:
        """Information of the motion alone."""
        return self._rows.information(*self.states(x))

    def motion(self, x: Array) -> Motion:
        """The source with the splines added."""
        source = self.source
        q, v, a = self._added(source, self._basis(source.time - source.time[0]), x)
        metadata = replace(source.metadata, generator=GRADIENT, verdict=None)
        return replace(source, q=q, v=v, a=a, metadata=metadata)

    def evaluate(self, x: Array, weight: float) -> tuple[float, Array]:
        """What is minimised, and its gradient ``(size,)``; ``weight`` is that of squared violations."""
        q, v, a = self.states(x)
        at_q, at_v = self._at_q, self._at_v
        width = np.ones(v.shape[1])
        width[at_v] = 0.02 * self._velocity
        sign = np.tanh(v / width)
        sign_slope = (1.0 - sign**2) / width
        full = self._rows.regressor(q, v, a)
        rows = self._rows.weighted(full, v, a, sign)
        flat = rows.reshape(-1, rows.shape[2])
        information = self._prior + flat.T @ flat
        value = -self._criterion.value(information)
        slope = -2.0 * (flat @ self._criterion.gradient(information)).reshape(rows.shape)
        weights, by_v, by_a = self._rows.pulled(slope, sign_slope, full.shape[2])
        penalty, parts = 0.0, []
        jerk = self._jerk + self._jerk_basis @ self._table(x)
        for values, limit in (
            (q[:, at_q] - self._middle, self._half),
            (v[:, at_v], self._velocity),
            (a[:, at_v], self._acceleration),
            (self._burden.values(full, v, a, sign), self._burden.most),
            (jerk, 0.9 * self._most_jerk),
        ):
            over = 10.0 * np.maximum(np.abs(values) / limit - 0.99, 0.0)
            penalty += float((over**2).sum())
            parts.append(20.0 * weight * over * np.sign(values) / limit)
        by_q, burden = parts[0], self._burden.pulled(parts[3], sign_slope)
        penalty += self._push_apart(q, weight, by_q)
        gradient: RegressorGradient = regressor_gradient(self._tree, q, v, a, weights + burden.weights)
        pulls = (
            gradient.q[:, at_v] + by_q,
            (gradient.v + by_v + burden.v)[:, at_v] + parts[1],
            (gradient.a + by_a + burden.a)[:, at_v] + parts[2],
        )
        found = sum(basis.T @ pull for basis, pull in zip(self._bases, pulls, strict=False))
        found = found + self._jerk_basis.T @ parts[4]
        return value + weight * penalty, _KNOT_S * np.asarray(found).ravel()

    def watch(self, x: Array) -> None:
        """Find the nearest points of bodies that are near each other, and what else is found once a round."""
        states = self.states(x)
        self._burden.watch(*states)
        poses, pairs = self._bodies.find(states[0], self._bodies.kept + _NEAR_M)
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
        lack = np.maximum(self._bodies.kept[near.pairs.pair] + _EXTRA_M - apart, 0.0) / 0.01
        slope = self._bodies.slopes(poses, replace(near.pairs, first=first, second=second))
        np.add.at(by_q, near.pairs.sample, (-2.0 * weight * lack / 0.01)[:, None] * slope)
        return float((lack**2).sum())


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
    rows: DesignRows,
    source: Motion,
    prior: Array,
    criterion: Criterion,
    *,
    robust: bool = False,
) -> Design:
    """The motion near a safe one that adds most to the information so far.

    Coefficients are those of B-splines of degree four that leave both ends at rest. Squared violations of the limits
    and of distances at coal's witness points are penalties, each round five times as heavy; L-BFGS-B minimises. The
    step is then shortened until the independent check finds the motion safe; with none left it is the source itself.

    Args:
        rows: of the robot.
        source: a safe motion.
        prior: ``(n_base, n_base)`` information so far, positive definite.
        criterion: what to make large.
        robust: whether the check asks for safety of all robots of the set that the description states. A standing
            robot's design leaves them no less than its source in any case.
    """
    program = DesignProgram(rows, source, prior, criterion)
    least = _least_margins(rows.robot, source) if rows.robot.floating and not robust else {}
    x = np.zeros(program.size)
    for k in range(_ROUNDS + _MORE_ROUNDS):
        program.watch(x)
        found = minimize(
            program.evaluate, x, args=(5.0**k,), jac=True, method="L-BFGS-B",
            bounds=np.stack([x - 2.0, x + 2.0], axis=1), options={"maxiter": _ITERATIONS, "maxcor": 15},
        )  # fmt: skip
        x = np.asarray(found.x)
        # Each time twice as much is taken off the step.
        for step in (1.0, *(1.0 - 0.01 * 2**i for i in range(7))) if k + 1 >= _ROUNDS else ():
            motion = program.motion(step * x)
            if _is_safe(rows.robot, motion, robust=robust, least=least):
                return Design(motion, program.information(step * x), step)
    return Design(source, program.information(0.0 * x), 0.0)


def design_motions(
    rows: DesignRows,
    sources: Sequence[Motion],
    start: Array,
    criterion: Criterion,
    *,
    robust: bool = False,
) -> list[Design]:
    """Designs of motions that are run together, each for what those before it lack.

    Args:
        rows: of the robot.
        sources: safe motions.
        start: ``(n_base, n_base)`` information to begin with, positive definite.
        criterion: what to make large.
        robust: as of :func:`design_motion`.
    """
    made: list[Design] = []
    information = start
    for source in sources:
        made.append(design_motion(rows, source, information, criterion, robust=robust))
        information = information + made[-1].information
    return made


def _least_margins(robot: Robot, source: Motion) -> dict[str, float]:
    """What a design of a standing robot has to leave of each margin over the stated set: no less than its source."""
    found = check_motion(robot, source, parameters=stated_parameters(robot)).robust
    worst = {} if found is None else found.worst
    return {name: min(one.value, one.limit) for name, one in worst.items() if one is not None}


def _is_safe(robot: Robot, motion: Motion, *, robust: bool, least: Mapping[str, float]) -> bool:
    if not least:
        return check_motion(robot, motion, robust=robust).safe
    verdict = check_motion(robot, motion)
    if not verdict.safe:
        return False
    left = _least_margins(robot, motion)
    return all(name in left and left[name] >= value for name, value in least.items())


@one_blas_thread
def first_information(rows: DesignRows, sources: Sequence[Motion]) -> Array:
    """A hundredth of what all sources say, which makes every determinant finite, ``(n_base, n_base)``."""
    total = np.zeros((len(rows.independent), len(rows.independent)))
    for motion in sources:
        sampled = motion.resampled(rows.robot, SEARCH_HZ)
        total += rows.information(sampled.q, sampled.v, sampled.a)
    return 0.01 * total / len(sources) + 1e-9 * np.diag(np.diag(total))
