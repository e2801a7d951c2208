"""Forces on a standing robot that its log does not know."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from excite.arrays import Array

Vector = tuple[float, float, float]
"""Three coordinates."""


class Pull(Protocol):
    """A force on a point of a link.

    Attributes:
        joint: index of the model joint that carries the link.
        point: in that joint's frame [m].
    """

    @property
    def joint(self) -> int:
        """Index of the model joint that carries the link."""
        ...

    @property
    def point(self) -> Vector:
        """The point in that joint's frame [m]."""
        ...

    def force(self, time: Array, place: Array, speed: Array, trial: int) -> Array:
        """World force ``(n, 3)`` [N] at ``time (n,)`` on a point at ``place (n, 3)`` with ``speed (n, 3)``."""
        ...


@dataclass(frozen=True)
class Tether:
    """A cable: a force that is constant but for a spring about the place where it was hooked on.

    Attributes:
        steady: [N]
        stiffness: [N/m]
        hooked: [m]
    """

    joint: int
    point: Vector
    steady: Vector
    stiffness: float
    hooked: Vector

    def force(self, time: Array, place: Array, speed: Array, trial: int) -> Array:
        """World force ``(n, 3)`` [N]: the steady one less the spring's, by the distance from where it was hooked on."""
        return np.asarray(np.array(self.steady) - self.stiffness * (place - np.array(self.hooked)))


@dataclass(frozen=True)
class Table:
    """Something soft to lean on, below ``height``; the force rises over ``depth`` and then stays.

    Attributes:
        height: [m]
        depth: over which it gives way [m].
        load: once it is pressed down [N].
        friction: horizontal share of that, by direction.
    """

    joint: int
    point: Vector
    height: float
    depth: float
    load: float
    friction: tuple[float, float]

    def force(self, time: Array, place: Array, speed: Array, trial: int) -> Array:
        """World force ``(n, 3)`` [N]: up by how deep the point is, and friction along its share of that."""
        s = np.clip((self.height - place[:, 2]) / self.depth, 0.0, 1.0)
        press = self.load * s**2 * (3.0 - 2.0 * s)
        return np.asarray(press[:, None] * np.array([*self.friction, 1.0]))


@dataclass(frozen=True)
class Jostle:
    """Somebody who pushes at random, otherwise in every trial.

    Attributes:
        size: standard deviation of each component [N].
        seed: of the numbers.
    """

    joint: int
    point: Vector
    size: float
    seed: int

    def force(self, time: Array, place: Array, speed: Array, trial: int) -> Array:
        """World force ``(n, 3)`` [N]: eight waves of 0.1 to 1.5 Hz along each axis, drawn by seed and trial."""
        rng = np.random.default_rng([self.seed, trial])
        hertz, phase = rng.uniform(0.1, 1.5, (8, 3)), rng.uniform(0.0, 2.0 * np.pi, (8, 3))
        waves = np.sin(2.0 * np.pi * hertz * time[:, None, None] + phase)
        return np.asarray(0.5 * self.size * waves.sum(axis=1))


@dataclass(frozen=True)
class Drag:
    """A cable bundle that rubs: a force against the point's velocity.

    Attributes:
        damping: [N·s/m]
    """

    joint: int
    point: Vector
    damping: float

    def force(self, time: Array, place: Array, speed: Array, trial: int) -> Array:
        """World force ``(n, 3)`` [N] against the velocity."""
        return -self.damping * speed


@dataclass(frozen=True)
class Slosh:
    """A tank on the robot: a mass on a spring, driven by the tank's own acceleration, that pushes back.

    Attributes:
        mass: that moves [kg]; its weight is in the model.
        hertz: of its oscillation.
        ratio: damping ratio.
    """

    joint: int
    point: Vector
    mass: float
    hertz: float
    ratio: float

    def force(self, time: Array, place: Array, speed: Array, trial: int) -> Array:
        """World force ``(n, 3)`` [N], horizontal: that of an oscillator driven by the point's acceleration."""
        from scipy.signal import cont2discrete, lfilter

        omega = 2.0 * np.pi * self.hertz
        step = float(time[1] - time[0])
        acceleration = np.gradient(speed, step, axis=0)
        # x'' + 2ζω x' + ω² x = −a; beyond the rigid mass, which the model has, the wall feels m (x'' + …) = m x''.
        numerator, denominator = [-1.0, 0.0, 0.0], [1.0, 2.0 * self.ratio * omega, omega**2]
        top, bottom, _ = cont2discrete((numerator, denominator), step, method="bilinear")
        out = -self.mass * lfilter(np.ravel(top), bottom, acceleration, axis=0)
        return np.column_stack([out[:, :2], np.zeros(len(time))])
