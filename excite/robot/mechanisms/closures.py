"""Equations that a mechanism's tree of joints has to meet: loops that close, joints that move together."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.polynomial import polynomial

from excite.arrays import Array

# Singular values of the passive joints' part of K below this share of the largest are rounding: equations that say
# the same, as a plane's do. A mechanism that is so near a singular position amplifies any error a million times.
SINGULAR = 1e-6


class Closure(ABC):
    """Equations ``gap(q) = 0``.

    Attributes:
        name: its name.
        field: where a robot's description says it.
        meets: model joints whose links touch in it; empty where none do.
    """

    name: str
    field: str
    meets: tuple[int, ...] = ()

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of equations, of which some may say the same."""

    @abstractmethod
    def gap(self, q: Array, data: pin.Data) -> Array:
        """How far it is open, ``(size,)`` [m, rad]; placements for ``q`` have to be in ``data``."""

    @abstractmethod
    def jacobian(self, model: pin.Model, q: Array, data: pin.Data) -> Array:
        """Derivative of :meth:`gap` by velocities, ``(size, nv)``; joint Jacobians have to be in ``data``."""

    @abstractmethod
    def drift(self, q: Array, v: Array, data: pin.Data) -> Array:
        """Second derivative of :meth:`gap` by time without acceleration, ``(size,)``.

        Velocities, and accelerations for accelerations of zero, have to be in ``data``.
        """


@dataclass(frozen=True, eq=False)
class Loop(Closure):
    """A loop cut open: two frames of a tree that meet.

    Attributes:
        name: its name.
        joints: model joints that carry the frames, 0 for the world.
        placements: the frames in those joints' frames.
        rigid: whether the frames' axes meet too; else their origins alone.
    """

    name: str
    joints: tuple[int, int]
    placements: tuple[pin.SE3, pin.SE3]
    rigid: bool = False
    field = "loops"

    @property
    def meets(self) -> tuple[int, ...]:  # type: ignore[override]
        """Those of its frames."""
        return self.joints

    @property
    def size(self) -> int:
        """Three, or six; in a plane some say the same."""
        return 6 if self.rigid else 3

    def gap(self, q: Array, data: pin.Data) -> Array:
        """Between the frames in the world."""
        first, second = (data.oMi[j] * m for j, m in zip(self.joints, self.placements, strict=True))
        gap = second.translation - first.translation
        if not self.rigid:
            return np.asarray(gap)
        return np.concatenate([gap, first.rotation @ pin.log3(first.rotation.T @ second.rotation)])

    def jacobian(self, model: pin.Model, q: Array, data: pin.Data) -> Array:
        """Of the gap while it is closed."""
        ends = zip(self.joints, self.placements, strict=True)
        first, second = (end_jacobian(model, data, *end) for end in ends)
        return np.asarray(second - first)[: self.size]

    def drift(self, q: Array, v: Array, data: pin.Data) -> Array:
        """Of the gap while it is closed."""
        ends = zip(self.joints, self.placements, strict=True)
        first, second = (end_acceleration(data, *end) for end in ends)
        return np.asarray(second - first)[: self.size]


@dataclass(frozen=True, eq=False)
class Rod(Closure):
    """A rod without mass between two points of a tree: their distance is its length.

    Attributes:
        name: its name.
        joints: model joints that carry the points, 0 for the world.
        placements: frames in those joints' frames whose origins the points are.
        length: [m]
    """

    name: str
    joints: tuple[int, int]
    placements: tuple[pin.SE3, pin.SE3]
    length: float
    field = "loops"

    @property
    def size(self) -> int:
        """One."""
        return 1

    def gap(self, q: Array, data: pin.Data) -> Array:
        """How much further apart the points are than the rod is long, while that is little."""
        across = self._across(data)
        return np.array([(across @ across - self.length**2) / (2.0 * self.length)])

    def jacobian(self, model: pin.Model, q: Array, data: pin.Data) -> Array:
        """Along the rod."""
        ends = [end_jacobian(model, data, *end)[:3] for end in zip(self.joints, self.placements, strict=True)]
        return np.asarray(self._across(data) @ (ends[1] - ends[0]) / self.length)[None]

    def drift(self, q: Array, v: Array, data: pin.Data) -> Array:
        """Of the points along the rod, and of the rod as it turns."""
        ends = list(zip(self.joints, self.placements, strict=True))
        speed = np.subtract(*(end_velocity(data, *end) for end in ends[::-1]))
        rate = np.subtract(*(end_acceleration(data, *end)[:3] for end in ends[::-1]))
        return np.array([(speed @ speed + self._across(data) @ rate) / self.length])

    def _across(self, data: pin.Data) -> Array:
        first, second = (
            data.oMi[j].act(m.translation) for j, m in zip(self.joints, self.placements, strict=True)
        )
        return np.asarray(second - first)


@dataclass(frozen=True, eq=False)
class Coupling(Closure):
    """Joints that move together: ``Σ p_j(q_j) = offset``, with polynomials ``p_j`` without constant term.

    Attributes:
        name: its name.
        columns: ``(index into q, index into v)`` of each joint, which has one coordinate.
        factors: of each joint's q, q², … in the order of ``columns``.
        offset: [rad or m]
    """

    name: str
    columns: tuple[tuple[int, int], ...]
    factors: tuple[tuple[float, ...], ...]
    offset: float = 0.0
    field = "couplings"

    @property
    def size(self) -> int:
        """One."""
        return 1

    @property
    def constant(self) -> bool:
        """Whether all its polynomials are factors."""
        return not any(any(factors[1:]) for factors in self.factors)

    def gap(self, q: Array, data: pin.Data) -> Array:
        """The sum less its offset."""
        return np.array([self._sum(q, 0) - self.offset])

    def jacobian(self, model: pin.Model, q: Array, data: pin.Data) -> Array:
        """The polynomials' first derivatives."""
        row = np.zeros((1, model.nv))
        for (position, column), factors in zip(self.columns, self.factors, strict=True):
            row[0, column] = _polynomial_derivative(factors, q[position], 1)
        return row

    def drift(self, q: Array, v: Array, data: pin.Data) -> Array:
        """The polynomials' second derivatives times squared velocities."""
        speeds = [v[column] ** 2 for _, column in self.columns]
        return np.array([self._sum(q, 2, speeds)])

    def _sum(self, q: Array, order: int, weights: list[float] | None = None) -> float:
        weights = weights or [1.0] * len(self.columns)
        return float(
            sum(
                weight * _polynomial_derivative(factors, q[position], order)
                for (position, _), factors, weight in zip(self.columns, self.factors, weights, strict=True)
            )
        )


def _polynomial_derivative(factors: tuple[float, ...], x: float, order: int) -> float:
    """A derivative at ``x`` of the polynomial without constant term."""
    return float(polynomial.polyval(x, polynomial.polyder(np.array([0.0, *factors]), order)))


def end_jacobian(model: pin.Model, data: pin.Data, joint: int, placement: pin.SE3) -> Array:
    """Velocity of a frame's origin and its angular velocity per joint velocity, world axes, ``(6, nv)``."""
    if not joint:
        return np.zeros((6, model.nv))
    # Of one velocity, pinocchio returns no matrix.
    jacobian = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL).reshape(6, model.nv)
    local = placement.actionInverse @ jacobian
    turned = data.oMi[joint].rotation @ placement.rotation
    return np.vstack([turned @ local[:3], turned @ local[3:]])


def end_velocity(data: pin.Data, joint: int, placement: pin.SE3) -> Array:
    """Velocity of a frame's origin, world axes, ``(3,)``."""
    turned = data.oMi[joint].rotation @ placement.rotation
    return np.asarray(turned @ placement.actInv(data.v[joint]).linear)


def end_acceleration(data: pin.Data, joint: int, placement: pin.SE3) -> Array:
    """Acceleration of a frame's origin and its angular acceleration, world axes, ``(6,)``."""
    velocity, acceleration = placement.actInv(data.v[joint]), placement.actInv(data.a[joint])
    linear = acceleration.linear + pin.skew(velocity.angular) @ velocity.linear
    turned = data.oMi[joint].rotation @ placement.rotation
    return np.concatenate([turned @ linear, turned @ acceleration.angular])
