"""Finite Fourier series (Ni et al. 2024, section II.B, eq. 8 and 10)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.motion.generators.bodyparts import central_range, rest_joints, upper_body
from excite.motion.generators.candidate import Candidate, SupportPhase
from excite.motion.generators.curves import FourierCurve
from excite.motion.generators.generator import Generator
from excite.robot.robot import Robot

_HARMONICS = 5
_PERIOD = (4.0, 8.0)
_OTHERS = (0.3, 1.0)


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


class Fourier(Generator):
    """Fourier series whose coefficients are drawn, then scaled to the limits.

    The offset lies between the rest posture and the middle of each joint's range for an arm, and at rest for
    the upper body of a standing robot.
    """

    name: ClassVar[str] = "fourier"
    summary: ClassVar[str] = "finite Fourier series with random coefficients, upper body or arm"

    def applies(self, robot: Robot) -> bool:
        """Always."""
        return True

    def aims(self, robot: Robot) -> tuple[str, ...]:
        """Every joint that is in no leg."""
        return tuple(
            joint for joint, upper in zip(robot.joint_names, upper_body(robot), strict=True) if upper
        )

    def draw(self, robot: Robot, seed: int, targets: tuple[str, ...], name: str) -> Candidate:
        """One period of a series with five harmonics; the targets use the whole of their limits."""
        rng = np.random.default_rng(seed)
        lower, upper = central_range(robot)
        rest = rest_joints(robot)
        moving = upper_body(robot)
        offset = rest.copy()
        if not robot.feet:
            offset = rest + rng.uniform() * (0.5 * (lower + upper) - rest)
        omega = 2.0 * np.pi / rng.uniform(*_PERIOD)
        c_a, c_b = start_conditions(omega, _HARMONICS)
        a = _nullspace_draw(rng, c_a, robot.n_joints)
        b = _nullspace_draw(rng, c_b, robot.n_joints)
        reach = np.maximum(np.minimum(offset - lower, upper - offset), 0.05 * (upper - lower))
        share = rng.uniform(*_OTHERS, size=robot.n_joints)
        share[np.isin(robot.joint_names, targets)] = 1.0
        share[~moving] = 0.0
        factor = share * amplitude_scale(a, b, omega, reach, 0.8 * robot.limits.velocity)
        curve = FourierCurve(offset, factor[:, None] * a, factor[:, None] * b, omega)
        feet = tuple(foot.name for foot in robot.feet)
        phases = (SupportPhase(0.0, curve.length, feet),) if feet else ()
        return Candidate(name, self.name, targets, seed, curve, speed=1.0, phases=phases)


def _nullspace_draw(rng: np.random.Generator, rows: Array, count: int) -> Array:
    """Normal draws, projected onto the null space of ``rows``: ``(count, L)``."""
    draws = rng.standard_normal((count, rows.shape[1]))
    return draws - draws @ np.linalg.pinv(rows) @ rows
