"""Motions of joints and hands: random positions (Jovic et al. 2015, section II.B), random places, Fourier series."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.motion.generators.curves import FourierCurve, SplineCurve
from excite.motion.generators.generator import (
    Candidate,
    Draws,
    Generator,
    all_feet,
    central_range,
    free_upper_body,
    rest_joints,
    upper_body,
)
from excite.robot.robot import Robot

# Random joint positions, one target joint at a time (Jovic et al. 2015, section II.B).

# Control points: of the many light joints of a standing robot, of an arm that takes a second from one to the next.
_WAYPOINTS, _ARM_WAYPOINTS = (9, 14), (6, 10)


def posture_draws(robot: Robot, targets: tuple[str, ...], others: Array, first: int, stop: int) -> Draws:
    """The box for control points: 10–90 % of the range for targets, a part of it about rest for the others.

    Args:
        robot: the robot.
        targets: joints that move over 10–90 % of their range.
        others: share of that range which the other joints use, ``(n_joints,)``.
        first: index of the first control point that is drawn.
        stop: index after the last.
    """
    lower, upper = central_range(robot)
    rest = rest_joints(robot)
    share = np.where(np.isin(robot.joint_names, targets), 1.0, others)
    share[~upper_body(robot)] = 0.0
    # Rest may lie outside the central range (a joint resting near its stop): then the box reaches out to it.
    return Draws(
        lower=rest + share * (np.minimum(lower, rest) - rest),
        upper=rest + share * (np.maximum(upper, rest) - rest),
        first=first,
        stop=stop,
    )


def posture_curve(robot: Robot, draws: Draws, n_control: int, rng: np.random.Generator) -> SplineCurve:
    """A spline from rest to rest through drawn control points."""
    control = np.tile(rest_joints(robot), (n_control, 1))
    for i in range(draws.first, draws.stop):
        control[i] = draws.draw(rng)
    return SplineCurve(control)


class _UpperBody(Generator):
    """Aims at joints that are in no leg."""

    needs: ClassVar[str] = "all its joints are in legs"

    def applies(self, robot: Robot) -> bool:
        """For a robot with joints that are in no leg."""
        return bool(upper_body(robot).any())

    def aims(self, robot: Robot) -> tuple[str, ...]:
        """Every joint that is in no leg."""
        return tuple(
            joint for joint, upper in zip(robot.joint_names, upper_body(robot), strict=True) if upper
        )


class RandomJoint(_UpperBody):
    """Random positions between 10 % and 90 % of the range, run as fast as the limits allow.

    For each degree of freedom in turn there are motions that throw it through its range while the other
    joints use a random part of theirs. Legs of a standing robot only balance.
    """

    name: ClassVar[str] = "random_joint"
    summary: ClassVar[str] = "random positions in 10–90 % of each joint's range, upper body or arm"

    def draw(self, robot: Robot, seed: int, targets: tuple[str, ...], name: str) -> Candidate:
        """A spline through random control points, from rest to rest."""
        rng = np.random.default_rng(seed)
        n = int(rng.integers(*(_WAYPOINTS if robot.feet else _ARM_WAYPOINTS)))
        others = rng.uniform(0.15, 0.7, size=robot.n_joints)
        draws = self._postures(robot, posture_draws(robot, targets, others, 3, 3 + n), targets)
        posture = posture_curve(robot, draws, n + 6, rng)
        phases = all_feet(robot, posture.length)
        return Candidate(name, self.name, targets, seed, posture, draws=draws, phases=phases)

    def _postures(self, robot: Robot, box: Draws, targets: tuple[str, ...]) -> Draws:
        """Where postures are drawn from: the box itself."""
        return box


# Random places of a hand in the space that a description states, by inverse kinematics.

# Places are drawn so often until one is within reach; steps of damped least squares to each, and their damping [m].
_TRIES, _STEPS, _DAMPING = 8, 25, 0.05
# Nearer than this a hand is there [m].
_THERE = 5e-3


@dataclass(frozen=True, eq=False)
class HandDraws(Draws):
    """Postures in which a hand is somewhere in a space; the other joints are drawn as they come.

    Attributes:
        robot: the robot.
        hand: model joint that carries the hand, whose point is its centre of mass.
        moved: joints that carry the hand and no foot, ``(n,)``.
    """

    robot: Robot
    hand: int
    moved: NDArray[np.intp]

    def draw(self, rng: np.random.Generator) -> Array:
        """One posture; of eight places out of reach the last is come near to."""
        low, high = np.array(self.robot.description.collision.cell)
        for _ in range(_TRIES):
            posture, apart = self._reached(super().draw(rng), rng.uniform(low, high))
            if apart < _THERE:
                break
        return posture

    def _reached(self, joints: Array, place: Array) -> tuple[Array, float]:
        """The posture near ``joints`` in which the hand is at a place, and how far from it it stays [m].

        Steps are those of damped least squares (Wampler 1986).
        """
        model, moved = self.robot.model, self.moved
        data, q = model.createData(), self.robot.rest.copy()
        own = q[self.robot.n_base_q :]
        own[:] = joints
        for _ in range(_STEPS):
            pin.computeJointJacobians(model, data, q)
            hand = data.oMi[self.hand]
            point = hand.rotation @ model.inertias[self.hand].lever
            off = place - hand.translation - point
            if np.linalg.norm(off) < _THERE:
                break
            turning = pin.getJointJacobian(model, data, self.hand, pin.LOCAL_WORLD_ALIGNED)
            rows = (turning[:3] - pin.skew(point) @ turning[3:])[:, self.robot.n_base_v + moved]
            step = rows.T @ np.linalg.solve(rows @ rows.T + _DAMPING**2 * np.eye(3), off)
            own[moved] = np.clip(own[moved] + step, self.lower[moved], self.upper[moved])
        return own, float(np.linalg.norm(off))


class Reach(RandomJoint):
    """Random places of a hand in the space that the description states, in whatever postures it reaches them.

    What is aimed at further up a limb is aimed at by its end.
    """

    name: ClassVar[str] = "reach"
    summary: ClassVar[str] = "a hand at random places of the stated cell"
    needs: ClassVar[str] = "it needs collision.cell in its description, and joints that are in no leg"

    def applies(self, robot: Robot) -> bool:
        """For a robot with hands whose space is stated."""
        return robot.description.collision.cell is not None and bool(self.aims(robot))

    def aims(self, robot: Robot) -> tuple[str, ...]:
        """The last joint of every limb that is no leg."""
        ends = np.setdiff1d(np.arange(robot.model.njoints), robot.model.parents)
        own = ends - (robot.model.njoints - robot.n_joints)
        return tuple(robot.joint_names[i] for i in own if free_upper_body(robot)[i])

    def _postures(self, robot: Robot, box: Draws, targets: tuple[str, ...]) -> Draws:
        """Those that bring the hand into the space."""
        hand = list(robot.model.subtrees[robot.model.getJointId(targets[0])])[-1]
        above = np.array(robot.model.supports[hand]) - (robot.model.njoints - robot.n_joints)
        moved = np.intersect1d(above, np.flatnonzero(free_upper_body(robot)))
        return HandDraws(box.lower, box.upper, box.first, box.stop, robot, hand, moved)


# Finite Fourier series (Ni et al. 2024, section II.B, eq. 8 and 10).


def start_conditions(omega: float, harmonics: int) -> tuple[Array, Array]:
    """Rows that start at the offset with zero velocity and acceleration: ``C_a a = 0``, ``C_b b = 0``.

    From eq. (8) itself: position ``Σ b_l/(ω l) = 0``, velocity ``Σ a_l = 0``, acceleration ``Σ ω l b_l = 0``.
    The sums as printed in eq. (10), ``Σ a_l/l``, ``Σ b_l/l`` and ``Σ l a_l``, belong to a series with sine
    and cosine exchanged and would leave a velocity at the start.
    """
    number = np.arange(1, harmonics + 1)
    return np.ones((1, harmonics)), np.vstack([1.0 / (omega * number), omega * number])


def amplitude_scale(a: Array, b: Array, omega: float, position: Array, velocity: Array) -> Array:
    """Largest factors that keep the sums of amplitudes within limits, eq. (10), ``(dimension,)``.

    Args:
        a: sine coefficients, ``(dimension, L)`` [rad/s].
        b: cosine coefficients, ``(dimension, L)`` [rad/s].
        omega: fundamental angular frequency [rad/s].
        position: largest excursion from the offset, ``(dimension,)`` [rad].
        velocity: largest velocity, ``(dimension,)`` [rad/s].
    """
    amplitude = np.hypot(a, b)
    number = np.arange(1, a.shape[1] + 1)
    reach = (amplitude / number).sum(axis=1) / omega
    speed = amplitude.sum(axis=1)
    return np.asarray(np.minimum(position / reach, velocity / speed))


class Fourier(_UpperBody):
    """Fourier series whose coefficients are drawn, then scaled to the limits.

    The offset lies between the rest posture and the middle of each joint's range for an arm, and at rest for
    the upper body of a standing robot.
    """

    name: ClassVar[str] = "fourier"
    summary: ClassVar[str] = "finite Fourier series with random coefficients, upper body or arm"

    def draw(self, robot: Robot, seed: int, targets: tuple[str, ...], name: str) -> Candidate:
        """One period of a series with five harmonics; the targets use the whole of their limits."""
        rng = np.random.default_rng(seed)
        lower, upper = central_range(robot)
        rest = rest_joints(robot)
        moving = upper_body(robot)
        offset = rest.copy()
        if not robot.feet:
            offset = rest + rng.uniform() * (0.5 * (lower + upper) - rest)
        omega = 2.0 * np.pi / rng.uniform(4.0, 8.0)
        c_a, c_b = start_conditions(omega, 5)
        a = _nullspace_draw(rng, c_a, robot.n_joints)
        b = _nullspace_draw(rng, c_b, robot.n_joints)
        reach = np.maximum(np.minimum(offset - lower, upper - offset), 0.05 * (upper - lower))
        share = rng.uniform(0.3, 1.0, size=robot.n_joints)
        share[np.isin(robot.joint_names, targets)] = 1.0
        share[~moving] = 0.0
        factor = share * amplitude_scale(a, b, omega, reach, 0.8 * robot.limits.velocity)
        curve = FourierCurve(offset, factor[:, None] * a, factor[:, None] * b, omega)
        phases = all_feet(robot, curve.length)
        return Candidate(name, self.name, targets, seed, curve, speed=1.0, phases=phases)


def _nullspace_draw(rng: np.random.Generator, rows: Array, count: int) -> Array:
    """Normal draws, projected onto the null space of ``rows``: ``(count, L)``."""
    draws = rng.standard_normal((count, rows.shape[1]))
    return draws - draws @ np.linalg.pinv(rows) @ rows
