"""A motion evaluated once, on the finer grid on which it is judged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array, Flags, distinct_rows
from excite.errors import InputError
from excite.lazy_kernel import LazyKernel
from excite.motion.motion import Motion, interpolate_motion
from excite.regressor.force_loops import inward_pass
from excite.regressor.kernels import block_of, load_of
from excite.regressor.motion_loops import LANES, POS, by_sample, move_bodies
from excite.regressor.row_loops import write_screw
from excite.regressor.tree import KinematicTree, read_tree
from excite.robot.robot import Robot
from excite.safety.checks.control_points import JointBounds, joint_bounds
from excite.safety.ground_forces import ContactForces, distribute_wrench, zero_moment_point

# Grid of the judgement: this many times the motion's own rate, and never below MIN_RATE_HZ.
FINER = 2
MIN_RATE_HZ = 200.0
# Steps that differ by less than this share are one grid, which the finer one shares. Of other motions the own samples
# are added to the finer grid, and of its own those left out that are within this share of a step of one.
_EVEN, _APART = 1e-6, 0.3
# Contact forces and joint torques, smoother and dearer, are evaluated at about this rate.
TORQUE_RATE_HZ = 200.0


class Standing(NamedTuple):
    """Samples at which a robot stands on the same feet.

    Attributes:
        feet: which feet, as indices.
        rows: which of the samples asked for.
        counts: corners of each of the feet's soles.
        corners: these corners, foot after foot, ``(n_rows, n_corners, 3)`` [m], world frame.
        friction: coefficient of friction at each corner.
    """

    feet: NDArray[np.intp]
    rows: NDArray[np.intp]
    counts: list[int]
    corners: Array
    friction: Array


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
            if rate == own:
                return self.motion
            return self.motion.resampled(self.robot, rate)
        grid = time[0] + np.linspace(0.0, duration, round(duration * rate) + 1)
        after = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
        nearest = np.minimum(np.abs(grid - time[after - 1]), np.abs(grid - time[after]))
        return interpolate_motion(
            self.motion, self.robot, np.sort(np.append(time, grid[nearest * rate > _APART]))
        )

    @cached_property
    def bounds(self) -> JointBounds:
        """What the joints do not pass on each interval of the finer grid."""
        return joint_bounds(self.fine)

    @cached_property
    def dynamics(self) -> Dynamics:
        """Inverse dynamics, centre of mass, feet; screws at ``torque_samples``."""
        return compute_dynamics(self.robot, self.fine, self.torque_samples)

    @cached_property
    def contacts(self) -> Flags:
        """Contact flags on the finer grid, ``(n, n_feet)``, in the order of ``robot.feet``."""
        flags = [self.fine.contacts[foot.name] for foot in self.robot.feet]
        return np.column_stack(flags) if flags else np.zeros((self.fine.n_samples, 0), dtype=bool)

    @cached_property
    def sole_corners(self) -> tuple[Array, ...]:
        """Corners of each foot's sole, ``(n, n_corners, 3)`` [m], world frame."""
        places = self.dynamics
        return tuple(
            np.einsum("nij,cj->nci", places.rotation[:, i], foot.sole) + places.position[:, i, None]
            for i, foot in enumerate(self.robot.feet)
        )

    @cached_property
    def wrench(self) -> Array:
        """Total contact wrench that the motion requires, ``(n, 6)`` about the world origin [N, N·m]."""
        return self.dynamics.tau[:, :6]

    @cached_property
    def zmp(self) -> Array:
        """Zero-moment point on the ground, ``(n, 2)`` [m]."""
        return zero_moment_point(self.wrench)

    def on_feet(self, samples: NDArray[np.intp]) -> Iterator[Standing]:
        """Those of some samples at which the robot stands on a set of feet, set by set."""
        sets, member = distinct_rows(self.contacts)
        for number, flags in enumerate(sets):
            feet, rows = np.flatnonzero(flags), np.flatnonzero(member[samples] == number)
            if len(feet) and len(rows):
                corners = np.concatenate([self.sole_corners[i][samples[rows]] for i in feet], axis=1)
                counts = [len(self.robot.feet[i].sole) for i in feet]
                friction = np.repeat([self.robot.feet[i].friction for i in feet], counts)
                yield Standing(feet, rows, counts, corners, friction)

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
        for feet, rows, counts, corners, friction in self.on_feet(samples):
            shared = distribute_wrench(self.wrench[samples[rows]], corners, friction)
            residual[rows] = shared.residual
            for i, part in zip(feet, np.split(shared.forces, np.cumsum(counts)[:-1], axis=1), strict=True):
                forces[i][rows] = part
        return tuple(ContactForces(part, residual) for part in forces)


# Forces, centre of mass and places of a robot's bodies along a motion, which several checks want to know.


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Rigid-body quantities at the samples of a motion, world frame.

    Attributes:
        tau: ``(n, nv)`` inverse dynamics without contacts [N·m or N]; of a robot on feet the base's rows are the wrench
            (force, moment) that the ground has to supply, about the world's origin.
        com: ``(n, 3)`` centre of mass [m].
        screws: ``(m, n_joints + 1, 6)`` at the samples asked for, by pinocchio's index: what each joint carries of a
            wrench about the world's origin on what it moves. None of a robot without feet.
        rotation: ``(n, n_feet, 3, 3)`` of the joints that carry the feet.
        position: ``(n, n_feet, 3)`` of the same [m].
    """

    tau: Array
    com: Array
    screws: Array
    rotation: Array
    position: Array


def compute_dynamics(robot: Robot, motion: Motion, asked: NDArray[np.intp]) -> Dynamics:
    """Inverse dynamics of a motion and what comes with it; ``asked`` are the samples at which screws are wanted.

    A robot without feet is left to pinocchio: few samples of an arm are done before compiled loops are loaded. One on
    feet needs those anyway, for its balance, and each of a G1's samples takes them a third of pinocchio's time.
    """
    n, feet, moved = motion.n_samples, robot.feet, (motion.q, motion.v, motion.a)
    found = Dynamics(
        tau=np.empty((n, robot.model.nv)),
        com=np.empty((n, 3)),
        screws=np.zeros((len(asked), robot.model.njoints, 6)) if feet else np.zeros((0, 0, 6)),
        rotation=np.empty((n, len(feet), 3, 3)),
        position=np.empty((n, len(feet), 3)),
    )
    if not feet:
        data = robot.model.createData()
        for k, (q, v, a) in enumerate(zip(*moved, strict=True)):
            found.tau[k] = pin.rnea(robot.model, data, q, v, a)
            found.com[k] = pin.centerOfMass(robot.model, data, q)
        return found
    tree, rows = _kinematic_tree(robot), np.full(n, -1)
    rows[asked] = np.arange(len(asked))
    _stand_on_feet(
        tree.structure, tree.gravity, *(np.ascontiguousarray(part, dtype=float) for part in moved), tree.phi,
        np.array([foot.joint for foot in feet]), rows, *block_of(tree), *load_of(tree),
        found.tau, found.com, found.screws, found.rotation, found.position,
    )  # fmt: skip
    return found


@lru_cache(maxsize=4)
def _kinematic_tree(robot: Robot) -> KinematicTree:
    return read_tree(robot.model)


@LazyKernel
def _stand_on_feet(
    structure, gravity, q, v, a, phi, feet, rows, room, block, state, forces, load,
    tau, com, screws, rotation, position,
):  # fmt: skip
    """Fill in what :class:`Dynamics` has of a robot on feet; arrays from ``room`` to ``load`` are scratch.

    ``rows (n,)`` says which row of ``screws`` is a sample's, none if negative.
    """
    kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned = structure
    for first in range(0, q.shape[0], LANES):
        move_bodies(
            kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned, gravity, True,
            q, v, a, first, room, block,
        )  # fmt: skip
        by_sample(block, state)
        inward_pass(kinds, parents, idx_v, phi, block, forces, load, first, tau)
        for b in range(min(LANES, q.shape[0] - first)):
            t = first + b
            _centre_of_mass(phi, state, b, com[t])
            for k in range(feet.shape[0]):
                for i in range(3):
                    position[t, k, i] = state[b, feet[k], POS + i]
                    for c in range(3):
                        rotation[t, k, i, c] = state[b, feet[k], 3 * i + c]
            if rows[t] >= 0:
                for j in range(1, state.shape[1]):
                    write_screw(kinds[j], state, j, b, screws[rows[t]])


@LazyKernel
def _centre_of_mass(phi, state, b, com):
    """Centre of mass in lane ``b``."""
    mass, x, y, z = 0.0, 0.0, 0.0, 0.0
    for j in range(1, state.shape[1]):
        first = 10 * (j - 1)
        m, hx, hy, hz = phi[first], phi[first + 1], phi[first + 2], phi[first + 3]
        mass += m
        x += m * state[b, j, POS] + state[b, j, 0] * hx + state[b, j, 1] * hy + state[b, j, 2] * hz
        y += m * state[b, j, POS + 1] + state[b, j, 3] * hx + state[b, j, 4] * hy + state[b, j, 5] * hz
        z += m * state[b, j, POS + 2] + state[b, j, 6] * hx + state[b, j, 7] * hy + state[b, j, 8] * hz
    com[0], com[1], com[2] = x / mass, y / mass, z / mass
