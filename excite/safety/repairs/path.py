"""The path of the whole robot, base included, over the path parameter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from excite.arrays import Array
from excite.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class PathSample:
    """The path at some path parameters ``s``: ``q(s)`` and its derivatives in the tangent space.

    Run with ``ṡ`` and ``s̈`` it gives ``v = twist·ṡ`` and ``a = twist·s̈ + curvature·ṡ²``.

    Attributes:
        s: ``(n,)``.
        q: configurations, ``(n, nq)``.
        twist: ``(n, nv)`` velocity per unit of ṡ; base twist in the base frame.
        curvature: ``(n, nv)``, the derivative of ``twist``.
    """

    s: Array
    q: Array
    twist: Array
    curvature: Array

    def part(self, which: slice) -> PathSample:
        """Some of the samples."""
        return PathSample(self.s[which], self.q[which], self.twist[which], self.curvature[which])


@dataclass(frozen=True, eq=False)
class MotionPath:
    """A twice continuously differentiable path through whole-body configurations.

    Coordinates are cubic splines: base position and the rotation vector of the base relative to its
    orientation at rest (floating base), then the joints.

    Attributes:
        robot: the robot.
        s: knots, ``(n,)``.
        coordinates: ``(n, 6 + n_joints)`` or ``(n, n_joints)``; first derivatives vanish at both ends.
    """

    robot: Robot
    s: Array
    coordinates: Array

    @cached_property
    def _spline(self) -> scipy.interpolate.CubicSpline:
        return scipy.interpolate.CubicSpline(self.s, self.coordinates, bc_type="clamped")

    @cached_property
    def knots(self) -> PathSample:
        """The path at its knots."""
        return self.sample(self.s)

    def sample(self, s: Array) -> PathSample:
        """The path at path parameters ``(n,)`` inside its interval."""
        sample = self._open_sample(s)
        if self.robot.closing is None:
            return sample
        return PathSample(s, *self.robot.closing.complete_motion(sample.q, sample.twist, sample.curvature))

    def _open_sample(self, s: Array) -> PathSample:
        """The splines' sample; joints without a motor are where these happen to pass."""
        x, dx, ddx = (self._spline(s, order) for order in range(3))
        if not self.robot.floating:
            return PathSample(s, x, dx, ddx)
        rest = scipy.spatial.transform.Rotation.from_quat(self.robot.rest[3:7])
        rotation = rest * scipy.spatial.transform.Rotation.from_rotvec(x[:, 3:6])
        omega, omega_rate = angular_rates(x[:, 3:6], dx[:, 3:6], ddx[:, 3:6])
        inverse = rotation.inv()
        linear = inverse.apply(dx[:, :3])
        # d/ds of Rᵀ p': the frame turns away under the vector.
        linear_rate = inverse.apply(ddx[:, :3]) - np.cross(omega, linear)
        return PathSample(
            s=s,
            q=np.hstack([x[:, :3], rotation.as_quat(), x[:, 6:]]),
            twist=np.hstack([linear, omega, dx[:, 6:]]),
            curvature=np.hstack([linear_rate, omega_rate, ddx[:, 6:]]),
        )


class RunPath(NamedTuple):
    """Samples of a path that is run.

    Attributes:
        time: ``(n,)`` [s], from 0.
        s: ``(n,)`` path parameters.
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations.
    """

    time: Array
    s: Array
    q: Array
    v: Array
    a: Array


def run_path(path: MotionPath, law: TimeLaw, rate_hz: float) -> RunPath:
    """A path run by a time law that takes a whole number of samples at ``rate_hz``."""
    time = np.arange(round(law.duration * rate_hz) + 1) / rate_hz
    s, speed, acceleration = (law.evaluate(time, order) for order in range(3))
    sample = path.sample(s)
    a = sample.twist * acceleration[:, None] + sample.curvature * speed[:, None] ** 2
    return RunPath(time, s, sample.q, sample.twist * speed[:, None], a)


def coordinates_of(robot: Robot, q: Array) -> Array:
    """Path coordinates of configurations ``(n, nq)`` whose base is turned by less than π from rest."""
    if not robot.floating:
        return q
    rest = scipy.spatial.transform.Rotation.from_quat(robot.rest[3:7])
    turned = rest.inv() * scipy.spatial.transform.Rotation.from_quat(q[:, 3:7])
    return np.hstack([q[:, :3], turned.as_rotvec(), q[:, 7:]])


def angular_rates(r: Array, dr: Array, ddr: Array) -> tuple[Array, Array]:
    """Angular velocity and acceleration in the body frame from a rotation vector and its derivatives.

    ``ω = ṙ − c₁ r×ṙ + c₂ r×(r×ṙ)`` with ``c₁ = (1 − cos θ)/θ²``, ``c₂ = (θ − sin θ)/θ³``, ``θ = |r|`` (the right
    Jacobian of SO(3), Chirikjian 2012, eq. 10.86), and its derivative.

    Args:
        r: rotation vectors, ``(n, 3)`` [rad].
        dr: first derivatives, ``(n, 3)``.
        ddr: second derivatives, ``(n, 3)``.
    """
    theta = np.linalg.norm(r, axis=1, keepdims=True)
    square = theta**2
    small = theta < 0.05
    t = np.where(small, 1.0, theta)
    sin, cos = np.sin(t), np.cos(t)
    c1 = np.where(small, 1 / 2 - square / 24 + square**2 / 720, (1 - cos) / t**2)
    c2 = np.where(small, 1 / 6 - square / 120 + square**2 / 5040, (t - sin) / t**3)
    along = np.sum(r * dr, axis=1, keepdims=True)
    dc1 = along * np.where(small, -1 / 12 + square / 180, (t * sin - 2 * (1 - cos)) / t**4)
    dc2 = along * np.where(small, -1 / 60 + square / 1260, (t * (1 - cos) - 3 * (t - sin)) / t**5)
    first = np.cross(r, dr)
    second = np.cross(r, first)
    omega = dr - c1 * first + c2 * second
    rate = (
        ddr
        - dc1 * first
        - c1 * np.cross(r, ddr)
        + dc2 * second
        + c2 * (np.cross(dr, first) + np.cross(r, np.cross(r, ddr)))
    )
    return omega, rate


# How fast a path is run: the path parameter as a smooth function of time.


@dataclass(frozen=True, eq=False)
class TimeLaw:
    """``s(t)`` as a cubic spline that starts and ends with ``ṡ`` as given.

    Attributes:
        time: knots, ``(n,)`` [s], from 0.
        s: path parameter at the knots, ``(n,)``, not decreasing.
        rate: ``ṡ`` at the first and the last knot [1/s].
    """

    time: Array
    s: Array
    rate: tuple[float, float] = (0.0, 0.0)

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""
        return float(self.time[-1])

    @cached_property
    def _spline(self) -> scipy.interpolate.CubicSpline:
        return scipy.interpolate.CubicSpline(
            self.time, self.s, bc_type=((1, self.rate[0]), (1, self.rate[1]))
        )

    def evaluate(self, time: Array, order: int = 0) -> Array:
        """``s``, ``ṡ`` or ``s̈`` at times ``(n,)``; the value of ``s`` never leaves the path's interval."""
        values = self._spline(np.clip(time, 0.0, self.duration), order)
        return np.asarray(np.clip(values, self.s[0], self.s[-1]) if order == 0 else values)

    def faster(self, k: float) -> TimeLaw:
        """The same law ``k`` times as fast."""
        return TimeLaw(self.time / k, self.s, (self.rate[0] * k, self.rate[1] * k))
