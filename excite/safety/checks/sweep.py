"""A motion evaluated once, on the finer grid on which it is judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import InputError
from excite.motion.motion import Motion, interpolate
from excite.robot.robot import Robot
from excite.safety.contact_wrench import wrench_at_world_origin, zero_moment_point
from excite.safety.force_distribution import ContactForces, distribute_wrench

# Grid of the judgement: this many times the motion's own rate, and never below MIN_RATE_HZ.
FINER = 2
MIN_RATE_HZ = 200.0
# Steps that differ by less than this share are one grid, which the finer one shares. Of other motions the own samples
# are added to the finer grid, and of its own those left out that are within this share of a step of one.
_EVEN, _APART = 1e-6, 0.3
# Contact forces and joint torques, smoother and dearer, are evaluated at about this rate.
TORQUE_RATE_HZ = 200.0


@dataclass(frozen=True, eq=False)
class ControlPoints:
    """Bézier control points of the joints' motion on each interval of the finer grid.

    Between samples a motion follows quintic polynomials; a polynomial never leaves the range of its control
    points (Farin 2002, section 4.3), so bounds on these hold at every instant, not only at samples.

    Attributes:
        position: ``(n-1, 6, n_joints)`` [rad or m].
        velocity: ``(n-1, 5, n_joints)`` [rad/s or m/s].
        acceleration: ``(n-1, 4, n_joints)`` [rad/s² or m/s²].
    """

    position: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Rigid-body quantities at the samples of the finer grid, world frame.

    Attributes:
        tau: ``(n, nv)`` inverse dynamics without contacts; base rows in the base frame [N, N·m].
        jacobian: ``(m, 6, nv)`` at the sweep's ``torque_samples``; columns are the joints' spatial axes,
            linear then angular, about the world origin.
        com: ``(n, 3)`` centre of mass [m].
        rotation: ``(n, n_feet + 1, 3, 3)`` of the base (first; identity for a fixed one) and of the joints
            that carry the feet.
        position: ``(n, n_feet + 1, 3)`` of the same [m].
    """

    tau: Array
    jacobian: Array
    com: Array
    rotation: Array
    position: Array


@dataclass(frozen=True, eq=False)
class Sweep:
    """A motion and what several checks want to know of it, each computed at most once.

    Attributes:
        robot: the robot.
        motion: the motion as handed over.
        rate_hz: rate of the finer grid, never below the motion's own; None for :data:`FINER` times that.
        neighbours: motions that are judged together with it, by name.
    """

    robot: Robot
    motion: Motion
    rate_hz: float | None = None
    neighbours: Mapping[str, Motion] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.rate_hz is not None and not (np.isfinite(self.rate_hz) and self.rate_hz > 0.0):
            raise InputError(f"rate {self.rate_hz} Hz is not positive", field="rate_hz")

    @cached_property
    def fine(self) -> Motion:
        """The motion on the finer grid; every one of its own samples is one of the grid's."""
        time, duration = self.motion.time, self.motion.duration
        own = (self.motion.n_samples - 1) / duration
        rate = max(FINER, int(np.ceil(MIN_RATE_HZ / own))) * own
        if self.rate_hz is not None:
            rate = max(self.rate_hz, own)
        step = np.diff(time)
        if step.max() - step.min() <= _EVEN * step.max():
            return self.motion.resampled(self.robot, rate)
        grid = time[0] + np.linspace(0.0, duration, round(duration * rate) + 1)
        after = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
        nearest = np.minimum(np.abs(grid - time[after - 1]), np.abs(grid - time[after]))
        return interpolate(self.motion, self.robot, np.sort(np.append(time, grid[nearest * rate > _APART])))

    @cached_property
    def control_points(self) -> ControlPoints:
        """Bézier control points of the quintic interpolant on each interval of the finer grid."""
        fine = self.fine
        h = np.diff(fine.time)[:, None]
        q, v, a = fine.joint_positions(), fine.joint_velocities(), fine.joint_accelerations()
        step = np.diff(q, axis=0)
        offsets = np.stack(
            [
                np.zeros_like(step),
                h * v[:-1] / 5.0,
                2.0 * h * v[:-1] / 5.0 + h**2 * a[:-1] / 20.0,
                step - 2.0 * h * v[1:] / 5.0 + h**2 * a[1:] / 20.0,
                step - h * v[1:] / 5.0,
                step,
            ],
            axis=1,
        )
        velocity = 5.0 * np.diff(offsets, axis=1) / h[:, None]
        acceleration = 4.0 * np.diff(velocity, axis=1) / h[:, None]
        return ControlPoints(q[:-1, None] + offsets, velocity, acceleration)

    @cached_property
    def dynamics(self) -> Dynamics:
        """Inverse dynamics, Jacobians, centre of mass and foot poses on the finer grid."""
        model, fine = self.robot.model, self.fine
        data = model.createData()
        joints = [1 if self.robot.floating else 0] + [foot.joint for foot in self.robot.feet]
        n = fine.n_samples
        rows = {int(k): row for row, k in enumerate(self.torque_samples)}
        tau, jacobian, com = np.empty((n, model.nv)), np.empty((len(rows), 6, model.nv)), np.empty((n, 3))
        poses = np.empty((n, len(joints), 4, 4))
        for k in range(n):
            tau[k] = pin.rnea(model, data, fine.q[k], fine.v[k], fine.a[k])
            if k in rows:
                # Of one velocity, pinocchio returns no matrix.
                jacobian[rows[k]] = pin.computeJointJacobians(model, data, fine.q[k]).reshape(6, model.nv)
            # Also computes where the joints are.
            com[k] = pin.centerOfMass(model, data, fine.q[k], False)
            for i, joint in enumerate(joints):
                poses[k, i] = data.oMi[joint].homogeneous
        return Dynamics(tau, jacobian, com, poses[:, :, :3, :3], poses[:, :, :3, 3])

    @cached_property
    def contacts(self) -> NDArray[np.bool_]:
        """Contact flags on the finer grid, ``(n, n_feet)``, in the order of ``robot.feet``."""
        flags = [self.fine.contacts[foot.name] for foot in self.robot.feet]
        return np.column_stack(flags) if flags else np.zeros((self.fine.n_samples, 0), dtype=bool)

    @cached_property
    def sole_corners(self) -> tuple[Array, ...]:
        """Corners of each foot's sole, ``(n, n_corners, 3)`` [m], world frame."""
        dynamics = self.dynamics
        return tuple(
            np.einsum("nij,cj->nci", dynamics.rotation[:, i], foot.sole) + dynamics.position[:, i, None]
            for i, foot in enumerate(self.robot.feet, start=1)
        )

    @cached_property
    def wrench(self) -> Array:
        """Total contact wrench that the motion requires, ``(n, 6)`` about the world origin [N, N·m]."""
        dynamics = self.dynamics
        return wrench_at_world_origin(dynamics.tau[:, :6], dynamics.rotation[:, 0], dynamics.position[:, 0])

    @cached_property
    def zmp(self) -> Array:
        """Zero-moment point on the ground, ``(n, 2)`` [m]."""
        return zero_moment_point(self.wrench)

    def contact_phases(self) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
        """Samples by set of feet in contact: pairs of the feet's and the samples' indices."""
        sets, member = np.unique(self.contacts, axis=0, return_inverse=True)
        return [(np.flatnonzero(row), np.flatnonzero(member.ravel() == i)) for i, row in enumerate(sets)]

    @cached_property
    def torque_samples(self) -> NDArray[np.intp]:
        """Samples of the finer grid with contact forces and torques, the last one among them."""
        n = self.fine.n_samples
        stride = max(1, int((n - 1) / self.motion.duration / TORQUE_RATE_HZ + 0.5))
        return np.unique(np.append(np.arange(0, n, stride), n - 1))

    @cached_property
    def contact_forces(self) -> tuple[ContactForces, ...]:
        """Forces on each foot's corners at ``torque_samples``; zero for feet in the air.

        Every entry carries the residual of the whole wrench; it is infinite where no foot is in contact.
        """
        samples = self.torque_samples
        forces = [np.zeros((len(samples), len(foot.sole), 3)) for foot in self.robot.feet]
        residual = np.full(len(samples), np.inf)
        for feet, members in self.contact_phases():
            rows = np.flatnonzero(np.isin(samples, members))
            if not len(feet) or not len(rows):
                continue
            corners = np.concatenate([self.sole_corners[i][samples[rows]] for i in feet], axis=1)
            counts = [len(self.robot.feet[i].sole) for i in feet]
            friction = np.repeat([self.robot.feet[i].friction for i in feet], counts)
            shared = distribute_wrench(self.wrench[samples[rows]], corners, friction)
            residual[rows] = shared.residual
            for i, part in zip(feet, np.split(shared.forces, np.cumsum(counts)[:-1], axis=1), strict=True):
                forces[i][rows] = part
        return tuple(ContactForces(part, residual) for part in forces)
