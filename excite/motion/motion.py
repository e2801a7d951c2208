"""A motion: what every joint, the base and the contacts do over time."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin
import scipy
from numpy.typing import NDArray

from excite.arrays import Array, Flags, Moved
from excite.display import count
from excite.errors import MotionError
from excite.motion.setpoints import Curve, is_sparse
from excite.robot.robot import Robot


@dataclass(frozen=True)
class MotionMetadata:
    """Where a motion comes from.

    Attributes:
        generator: registry name of the generator that made it, or ``recorded``.
        seed: seed of its random numbers, None where there are none.
        targets: joints that it was aimed at.
        robot_hash: hash of the robot that it was made for; empty where nobody says.
        versions: versions of the packages that made it.
        previous: name of the motion that it goes on from; empty where it starts at rest.
        following: name of the motion that goes on from it; empty where it ends at rest.
        verdict: what the independent check said of it: the motion's entry in ``excite.check/1``, with the
            ``robot_hash`` and ``content_hash`` of the robot and the samples that it belongs to; None without one.
        stated_hash: content hash that its file states, where that is not the hash of what the file holds.
    """

    generator: str = "unknown"
    seed: int | None = None
    targets: tuple[str, ...] = ()
    robot_hash: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    previous: str = ""
    following: str = ""
    verdict: Mapping[str, Any] | None = None
    stated_hash: str = ""


@dataclass(frozen=True, eq=False)
class Motion:
    """Samples of a whole-body motion, in the conventions of :class:`~excite.robot.robot.Robot`.

    Attributes:
        name: name of the motion, its file's stem.
        robot: name of the robot.
        joint_names: actuated joints, in the order of the columns.
        time: ``(n,)`` [s], strictly increasing.
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations.
        contacts: by foot name, ``(n,)`` booleans: True while the foot carries load on the ground.
        metadata: where it comes from.
        curve: what runs between samples; quintic polynomials unless its file stated too little for them.
    """

    name: str
    robot: str
    joint_names: tuple[str, ...]
    time: Array
    q: Array
    v: Array
    a: Array
    contacts: Mapping[str, Flags] = field(default_factory=dict)
    metadata: MotionMetadata = field(default_factory=MotionMetadata)
    curve: Curve = "quintic"

    def __repr__(self) -> str:
        return (
            f"Motion({self.name!r}, {self.robot}, {count(len(self.joint_names), 'joint')}, {self.n_samples} samples, "
            f"{self.duration:.1f} s)"
        )

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return len(self.time)

    @property
    def floating(self) -> bool:
        """Whether it moves a free base."""
        return bool(self.v.shape[1] > len(self.joint_names))

    def joint_positions(self) -> Array:
        """Positions of the actuated joints, ``(n, n_joints)`` [rad or m]."""
        return self.q[:, self.q.shape[1] - len(self.joint_names) :]

    def joint_velocities(self) -> Array:
        """Velocities of the actuated joints, ``(n, n_joints)`` [rad/s or m/s]."""
        return self.v[:, self.v.shape[1] - len(self.joint_names) :]

    def joint_accelerations(self) -> Array:
        """Accelerations of the actuated joints, ``(n, n_joints)`` [rad/s² or m/s²]."""
        return self.a[:, self.a.shape[1] - len(self.joint_names) :]

    @property
    def is_goal(self) -> bool:
        """Whether its samples are setpoints of a controller that runs a curve through them."""
        return not self.floating and self.curve != "spline" and is_sparse(self.time)

    def renamed(self, name: str) -> Motion:
        """The same motion under another name."""
        return replace(self, name=name)

    def resampled(self, robot: Robot, rate_hz: float) -> Motion:
        """The motion on a uniform grid of ``rate_hz``, by cubic Hermite interpolation of q, v.

        Velocities and accelerations are the interpolant's own derivatives, so that the three belong together;
        contacts take the value of the sample before.
        """
        n = max(2, round(self.duration * rate_hz) + 1)
        time = self.time[0] + np.linspace(0.0, self.duration, n)
        return interpolate_motion(self, robot, time)


def interpolate_motion(motion: Motion, robot: Robot, time: Array) -> Motion:
    """Evaluate a motion at other times, inside its own span.

    On each interval the configuration follows the quintic Hermite polynomial of the increment in the
    tangent space at the interval's first sample, which matches q, v and a at both ends (exactly for joints,
    to third order in the interval's rotation for a free base).

    Args:
        motion: the motion.
        robot: its robot.
        time: ``(m,)`` [s], increasing, inside ``motion.time``.

    Returns:
        The motion at ``time``.

    Raises:
        MotionError: the motion moves other joints than the robot's.
    """
    if motion.joint_names != robot.joint_names:
        raise MotionError(
            f"moves other joints than {robot.name}", source=motion.name, remedy=f"is it for {robot.name!r}?"
        )
    time = np.asarray(time, dtype=float)
    index = np.clip(np.searchsorted(motion.time, time, side="right") - 1, 0, motion.n_samples - 2)
    shares = np.clip((time - motion.time[index]) / (motion.time[index + 1] - motion.time[index]), 0.0, 1.0)
    q, v, a = _quintics_at(motion, index, shares[:, None])
    contacts = {name: flags[index] for name, flags in motion.contacts.items()}
    return replace(motion, time=time, q=q, v=v, a=a, contacts=contacts)


class Instants:
    """Configurations at single times, as :func:`interpolate_motion` gives them, for searches that "
    "ask for one at a time."""

    def __init__(self, motion: Motion, robot: Robot):
        self._motion, self._model = motion, robot.model
        self._floating = motion.floating
        self._times: list[float] = motion.time.tolist()
        # Polynomials of the intervals that were asked for: a search comes back to few of them.
        self._polynomials: dict[int, Array] = {}

    def at(self, time: float) -> Array:
        """Configuration at one time [s], inside ``motion.time``: ``(nq,)`` [rad or m]."""
        end = min(max(bisect_left(self._times, time), 1), len(self._times) - 1)
        if time == self._times[end]:
            return np.asarray(self._motion.q[end])
        known = self._polynomials.get(end)
        if known is None:
            known = self._polynomials[end] = self._polynomial(end)
        h = self._times[end] - self._times[end - 1]
        s = min(max((time - self._times[end - 1]) / h, 0.0), 1.0)
        c1, c2, c3, c4, c5 = known
        d = s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))))
        start = self._motion.q[end - 1]
        return np.asarray(pin.integrate(self._model, start, d) if self._floating else start + d)

    def _polynomial(self, end: int) -> Array:
        """Coefficients of the interval that ends with a sample, ``(5, nv)``."""
        m, start = self._motion, end - 1
        h = m.time[end] - m.time[start]
        if self._floating:
            step = pin.difference(self._model, m.q[start], m.q[end])
        else:
            step = m.q[end] - m.q[start]
        return np.array(_quintic_coefficients(h, step, m.v[start], m.v[end], m.a[start], m.a[end]))


def _quintic_coefficients(h: Array, step: Array, v0: Array, v1: Array, a0: Array, a1: Array) -> list[Array]:
    """Coefficients of s … s⁵ with d(0) = 0, d(1) = step, d' = h v and d'' = h² a at both ends."""
    c1, c2 = h * v0, 0.5 * (h * h) * a0
    r0 = step - c1 - c2
    r1 = h * v1 - c1 - 2 * c2
    r2 = (h * h) * a1 - 2 * c2
    return [c1, c2, 10 * r0 - 4 * r1 + 0.5 * r2, -15 * r0 + 7 * r1 - r2, 6 * r0 - 3 * r1 + 0.5 * r2]


def jerk_peaks(time: Array, q: Array, v: Array, a: Array) -> Array:
    """Largest magnitude of the third derivative of the quintic between samples, ``(n-1, m)``.

    Args:
        time: ``(n,)`` [s].
        q: ``(n, m)`` [rad or m].
        v: ``(n, m)`` [rad/s or m/s].
        a: ``(n, m)`` [rad/s² or m/s²].
    """
    h = np.diff(time)[:, None]
    _, _, c3, c4, c5 = _quintic_coefficients(h, np.diff(q, axis=0), v[:-1], v[1:], a[:-1], a[1:])
    turn = np.clip(np.divide(-c4, 5.0 * c5, out=np.zeros_like(c5), where=c5 != 0.0), 0.0, 1.0)
    at = [np.abs(6.0 * c3 + s * (24.0 * c4 + s * 60.0 * c5)) for s in (0.0, turn, 1.0)]
    return np.asarray(np.max(at, axis=0) / h**3)


def closed_contacts(robot: Robot, motion: Motion) -> Flags:
    """Contact flags in the order of ``robot.feet``, ``(n, n_feet)``; set where the motion says nothing of a foot."""
    every = np.ones(motion.n_samples, dtype=bool)
    flags = [motion.contacts.get(foot.name, every) for foot in robot.feet]
    return np.column_stack(flags) if flags else np.zeros((motion.n_samples, 0), dtype=bool)


def _quintics_at(motion: Motion, index: NDArray[np.intp], s: Array) -> Moved:
    """Configurations, velocities and accelerations some shares ``(m, 1)`` of the way from samples to the next ones."""
    start, end = motion.q[index], motion.q[index + 1]
    h = (motion.time[index + 1] - motion.time[index])[:, None]
    ends = motion.v[index], motion.v[index + 1], motion.a[index], motion.a[index + 1]
    step = end - start
    if motion.floating:
        known, where = np.unique(index, return_inverse=True)
        base = base_steps(motion.q[known, :7], motion.q[known + 1, :7])
        step = np.hstack([base[where], step[:, 7:]])
    c1, c2, c3, c4, c5 = _quintic_coefficients(h, step, *ends)
    way = s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))))
    v = (c1 + s * (2 * c2 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h
    a = (2 * c2 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / h**2
    if not motion.floating:
        return Moved(start + way, v, a)
    return Moved(np.hstack([moved_bases(start[:, :7], way[:, :6]), start[:, 7:] + way[:, 6:]]), v, a)


# A free base's step from one sample to the next is a twist of the frame that it starts from: ``M₁ = M₀
# exp(step)`` on SE(3), the linear part of the twist first, as in pinocchio; of all samples at once.

# Squared angles below which sines and cosines are replaced by the first terms of their series, of which those left out
# are then below a double's rounding.
_SMALL = 1e-6


def base_steps(start: Array, end: Array) -> Array:
    """Twists ``(n, 6)`` from poses, position and quaternion x y z w ``(n, 7)``, to others [m, rad]."""
    first = scipy.spatial.transform.Rotation.from_quat(start[:, 3:])
    turn = (first.inv() * scipy.spatial.transform.Rotation.from_quat(end[:, 3:])).as_rotvec()
    way, square = first.inv().apply(end[:, :3] - start[:, :3]), (turn**2).sum(axis=1, keepdims=True)
    half = 0.5 * np.sqrt(np.maximum(square, _SMALL))
    bend = np.where(square < _SMALL, 1 / 12 + square / 720, (1.0 - half / np.tan(half)) / (4.0 * half**2))
    across = np.cross(turn, way)
    return np.hstack([way - 0.5 * across + bend * np.cross(turn, across), turn])


def moved_bases(start: Array, step: Array) -> Array:
    """The poses ``(n, 7)`` that twists ``(n, 6)`` take poses to; arguments as of :func:`base_steps`."""
    way, turn = step[:, :3], step[:, 3:]
    square = (turn**2).sum(axis=1, keepdims=True)
    angle = np.sqrt(np.maximum(square, _SMALL))
    small = square < _SMALL
    first = np.where(small, 1 / 2 - square / 24, (1.0 - np.cos(angle)) / angle**2)
    second = np.where(small, 1 / 6 - square / 120, (angle - np.sin(angle)) / angle**3)
    across = np.cross(turn, way)
    rotation = scipy.spatial.transform.Rotation.from_quat(start[:, 3:])
    moved = start[:, :3] + rotation.apply(way + first * across + second * np.cross(turn, across))
    turned = rotation * scipy.spatial.transform.Rotation.from_rotvec(turn)
    return np.hstack([moved, turned.as_quat()])
