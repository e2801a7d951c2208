"""What motions are designed with: weighted rows of base parameters, what else bounds a motion, and the ways back.

An arm's rows are its joint torques, and its drives bound it; a robot's on wrench sensors are those of the whole wrench,
and the ground bounds it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from excite.arrays import Array, Indices, Moved
from excite.errors import InputError
from excite.excitation.precision import row_noise
from excite.motion.generators.generator import free_upper_body
from excite.motion.motion import Motion
from excite.regressor.base_parameters import BaseParameters, structural_base_parameters
from excite.regressor.columns import DRIVE_TERMS, measured_columns
from excite.regressor.kernels import base_link_regressor, joint_torque_regressor
from excite.regressor.tree import KinematicTree, read_tree
from excite.robot.joint_values import per_joint
from excite.robot.robot import Robot
from excite.safety.checks.ground import ZMP_MARGIN
from excite.safety.checks.robustness import Facing, edges_of_support, faces_of_friction
from excite.safety.checks.sweep import Sweep
from excite.safety.parameter_set import RowsOfSet, stated_parameters

# What designs keep of the distance from the edge beyond the check's [m], and of the friction, for what happens between
# the samples; shares of either that count as much as a hundredth of a limit. Set while designing for one humanoid (G1);
# no experiment has varied them.
_EDGE_ROOM, _FRICTION_ROOM = 0.005, 0.02
_EDGE_UNIT, _FRICTION_UNIT = 0.02, 0.1


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
class DesignRows(ABC):
    """Weighted rows of a robot's base parameters, and the ways back from their derivatives to the motion's.

    Attributes:
        robot: the robot.
        terms: of each joint's drive that count as parameters, where sensors see them.
        is_weighted: whether rows are divided by the noise that the description states.
        chosen: columns that stand for the base parameters; the first independent ones if None.
    """

    robot: Robot
    terms: tuple[str, ...] = DRIVE_TERMS
    is_weighted: bool = True
    chosen: Indices | None = None

    @cached_property
    def base(self) -> BaseParameters:
        """The base parameters, drives included where sensors see them."""
        return structural_base_parameters(self.robot, self.terms)

    @cached_property
    def independent(self) -> Indices:
        """Columns that stand for the base parameters, ``(n_base,)``."""
        return self.base.independent if self.chosen is None else self.chosen

    @cached_property
    def tree(self) -> KinematicTree:
        """The robot's, for compiled kernels."""
        return read_tree(self.robot.model)

    @cached_property
    def _weights(self) -> Array:
        return 1.0 / row_noise(self.robot) if self.is_weighted else np.ones(self.robot.n_equations)

    @cached_property
    def _inertial(self) -> Indices:
        return measured_columns(self.robot, self.terms).inertial

    @property
    @abstractmethod
    def moved(self) -> NDArray[np.intp]:
        """Joints that designs move."""

    @abstractmethod
    def burden(self, sampled: Motion) -> DriveTorques | GroundForces:
        """What bounds motions near one at the search's samples beside their joints' limits."""

    @abstractmethod
    def regressor(self, q: Array, v: Array, a: Array) -> Array:
        """Rows in all parameters, ``(n, n_rows, 10·n_segments)``."""

    @abstractmethod
    def weighted(self, full: Array, v: Array, a: Array, sign: Array) -> Array:
        """Base columns over the noise, ``(n, n_rows, n_base)``, of a regressor ``full``."""

    @abstractmethod
    def pulled(self, slope: Array, sign_slope: Array, size: int) -> Pulled:
        """Gradients through the weighted rows, of which ``slope`` are those of the criterion."""

    def information(self, q: Array, v: Array, a: Array) -> Array:
        """Information of samples, ``(n_base, n_base)``."""
        rows = self.weighted(self.regressor(q, v, a), v, a, np.sign(v)).reshape(-1, len(self.independent))
        return np.asarray(rows.T @ rows)


@dataclass(frozen=True, eq=False)
class ArmRows(DesignRows):
    """The weighted regressor of an arm's base parameters, and the way back from its derivatives to the motion's.

    What the drives have to give, and can, is bounded.

    Attributes:
        robot: an arm whose joints all have motors.
    """

    def __post_init__(self) -> None:
        """Raise InputError for a robot without gradients."""
        if self.robot.floating or self.robot.mechanism is not None:
            raise InputError(
                "motions are optimised for arms with a motor in every joint",
                source=self.robot.name,
                remedy="use another generator: gradient for a robot that stands on force sensors",
            )

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

    @property
    def moved(self) -> NDArray[np.intp]:
        """Joints that designs move: all."""
        return np.arange(self.robot.n_joints)

    def regressor(self, q: Array, v: Array, a: Array) -> Array:
        """Rows of joint torques in all parameters, ``(n, n_joints, 10·n_segments)``."""
        return joint_torque_regressor(self.tree, q, v, a)

    def burden(self, sampled: Motion) -> DriveTorques:
        """What bounds motions beside their joints' limits."""
        return DriveTorques(self)

    def weighted(self, full: Array, v: Array, a: Array, sign: Array) -> Array:
        """Base columns over the noise, ``(n, n_joints, n_base)``, of a joint torque regressor ``full``."""
        rows = np.zeros((*v.shape, len(self._inertial) + len(self.terms) * v.shape[1]))
        rows[:, :, : len(self._inertial)] = full[:, :, self._inertial]
        values = {"viscous": v, "coulomb": sign, "offset": np.ones_like(v), "armature": a}
        for term, part in self._by_term(rows).items():
            np.einsum("njj->nj", part)[:] = values[term]
        return rows[:, :, self.independent] * self._weights[:, None]

    def pulled(self, slope: Array, sign_slope: Array, size: int) -> Pulled:
        """Weights of the regressor's entries ``(n, n_joints, size)``, and what drives pull at v and a."""
        n, n_joints, _ = slope.shape
        whole = np.zeros((n, n_joints, len(self._inertial) + len(self.terms) * n_joints))
        whole[:, :, self.independent] = slope * self._weights[:, None]
        weights = np.zeros((n, n_joints, size))
        weights[:, :, self._inertial] = whole[:, :, : len(self._inertial)]
        pull = dict.fromkeys(DRIVE_TERMS, np.zeros((n, n_joints)))
        pull |= {term: np.einsum("njj->nj", part) for term, part in self._by_term(whole).items()}
        return Pulled(weights, pull["viscous"] + pull["coulomb"] * sign_slope, pull["armature"])

    def _by_term(self, rows: Array) -> dict[str, Array]:
        """The columns of the drives' terms among all, ``(n, n_joints, n_joints)`` each."""
        ways = np.split(rows[:, :, len(self._inertial) :], len(self.terms), axis=2) if self.terms else []
        return dict(zip(self.terms, ways, strict=True))


@dataclass(frozen=True, eq=False)
class DriveTorques:
    """Torques of an arm's drives, below what they can give.

    Attributes:
        rows: of the arm.
    """

    rows: ArmRows

    @property
    def most(self) -> Array:
        """What they can give, ``(n_joints,)`` [N·m or N]."""
        return self.rows.robot.limits.torque

    def values(self, full: Array, v: Array, a: Array, sign: Array) -> Array:
        """Torques ``(n, n_joints)`` [N·m or N]."""
        return self.rows.torques(full, v, a, sign)

    def pulled(self, slope: Array, sign_slope: Array) -> Pulled:
        """Gradients of a sum of torques times ``slope``, ``(n, n_joints)``."""
        viscous, coulomb, armature = self.rows.drives
        weights = slope[:, :, None] * self.rows.tree.phi
        return Pulled(weights, slope * (viscous + coulomb * sign_slope), slope * armature)

    def watch(self, q: Array, v: Array, a: Array) -> None:
        """Nothing is to be found anew."""


@dataclass(frozen=True, eq=False)
class StandingRows(DesignRows):
    """The weighted regressor of a robot's whole wrench, as its feet's sensors sum it.

    Designs move the joints that no foot needs; the base and the legs move as in the source. What the ground can give is
    bounded, for every robot of the set that the description states.

    Attributes:
        robot: a robot on wrench sensors.
    """

    def __post_init__(self) -> None:
        """Raise InputError for a robot without such joints or sensors."""
        if not (self.robot.floating and self.robot.measures_contacts) or not len(self.moved):
            raise InputError(
                "of a standing robot motions are designed by gradients with force sensors in its feet and joints that "
                "no foot needs",
                source=self.robot.name,
                remedy="use another generator",
            )

    @cached_property
    def moved(self) -> NDArray[np.intp]:
        """Joints that designs move."""
        return np.flatnonzero(free_upper_body(self.robot))

    @cached_property
    def _columns(self) -> Indices:
        return self._inertial[self.independent]

    def regressor(self, q: Array, v: Array, a: Array) -> Array:
        """Rows of the whole wrench in all parameters, ``(n, 6, 10·n_segments)``."""
        return base_link_regressor(self.tree, q, v, a)

    def burden(self, sampled: Motion) -> GroundForces:
        """What bounds motions beside their joints' limits."""
        return GroundForces(self, sampled)

    def weighted(self, full: Array, v: Array, a: Array, sign: Array) -> Array:
        """Base columns over the noise, ``(n, 6, n_base)``."""
        return np.asarray(full[:, :, self._columns] * self._weights[:, None])

    def pulled(self, slope: Array, sign_slope: Array, size: int) -> Pulled:
        """Weights of the regressor's entries ``(n, 6, size)``; no drive is among the rows."""
        weights = np.zeros((*slope.shape[:2], size))
        weights[:, :, self._columns] = slope * self._weights[:, None]
        nothing = np.zeros(1)
        return Pulled(weights, nothing, nothing)


class GroundForces:
    """How near the whole wrench comes to what soles can give: the edge of their polygon, and friction.

    Both are planes that the wrench stays below (:mod:`excite.safety.checks.robustness`); base and legs move as in the
    source, so that planes do not depend on the design. What the stated set of robots takes of the room is found anew
    before each round.

    Args:
        rows: of the robot.
        sampled: the source at the search's samples.

    Raises:
        InputError: a motion in which nothing can be said of the ground.
    """

    def __init__(self, rows: StandingRows, sampled: Motion) -> None:
        self._tree = rows.tree
        robot, n = rows.robot, sampled.n_samples
        sweep = Sweep(robot, sampled, (n - 1) / sampled.duration)
        kinds = (
            (edges_of_support(sweep), ZMP_MARGIN, _EDGE_ROOM, _EDGE_UNIT),
            (faces_of_friction(sweep), 0.0, _FRICTION_ROOM, _FRICTION_UNIT),
        )
        found = [
            _by_sample(facing, n, limit + room, unit)
            for facing, limit, room, unit in kinds
            if facing is not None
        ]
        if len(found) < len(kinds):
            raise InputError("stands on no area at times", source=sampled.name, remedy="use another motion")
        weight = robot.mass * float(np.linalg.norm(robot.model.gravity.linear))
        self._world = np.concatenate(found, axis=1) / weight
        self._parameters = stated_parameters(robot)
        self._set = RowsOfSet(robot, self._parameters)
        turn = Rotation.from_quat(sampled.q[:, 3:7]).as_matrix()
        force, moment = self._world[..., :3], self._world[..., 3:]
        force = force + np.cross(moment, sampled.q[:, None, :3])
        # Planes of the wrench about the base, in its axes: n · (R f) + m · (R τ + p × R f).
        self._own = np.concatenate([force @ turn, moment @ turn], axis=-1)
        self._rise = np.zeros(self._own.shape[:2])
        # Where the source leaves less, a design leaves as much, and the room for what happens between the samples.
        self.watch(sampled.q, sampled.v, sampled.a)
        full = rows.regressor(sampled.q, sampled.v, sampled.a)
        used = self.values(full, sampled.v, sampled.a, sampled.v).max(axis=0)
        parts = np.split(used, [found[0].shape[1]])
        shares = [
            max(part.max() - room / unit, 1.0) for part, (_, _, room, unit) in zip(parts, kinds, strict=True)
        ]
        self.most = np.repeat(shares, [len(part) for part in parts])

    def values(self, full: Array, v: Array, a: Array, sign: Array) -> Array:
        """Shares of the room that are used, 1 at the limits, ``(n, n_planes)``."""
        wrench = full @ self._tree.phi
        return np.asarray(np.maximum(1.0 + np.einsum("nkw,nw->nk", self._own, wrench) + self._rise, 0.0))

    def pulled(self, slope: Array, sign_slope: Array) -> Pulled:
        """Gradients of a sum of shares times ``slope``, ``(n, n_planes)``."""
        nothing = np.zeros(1)
        by_wrench = np.einsum("nk,nkw->nw", slope, self._own)
        return Pulled(by_wrench[:, :, None] * self._tree.phi, nothing, nothing)

    def watch(self, q: Array, v: Array, a: Array) -> None:
        """Find what the set of robots takes of the room."""
        of_wrench = self._set.of_wrench(Moved(q, v, a)).of_wrench
        n, k = self._rise.shape
        samples = np.repeat(np.arange(n), k)
        rise = self._parameters.rise_of_forms(self._world.reshape(n * k, 6), samples, of_wrench)
        self._rise = rise.reshape(n, k)


def _by_sample(facing: Facing, n: int, room: float, unit: float) -> Array:
    """Planes of every sample about the world's origin, ``(n, n_planes, 6)``; those that are none are zero."""
    found = np.zeros((n, max(planes.shape[1] for planes in facing.planes), 6))
    for k, (about, planes) in enumerate(zip(facing.about, facing.planes, strict=True)):
        mine = np.flatnonzero(facing.phase == k)
        own = np.nan_to_num(planes if len(planes) == 1 else planes[mine])
        moved = own.copy()
        moved[..., :3] -= np.cross(own[..., 3:], about)
        moved[..., 2] += room * own.any(axis=-1)
        found[facing.samples[mine], : own.shape[1]] = moved / unit
    return found


def design_rows(robot: Robot) -> DesignRows:
    """Rows to design a robot's motions with; raises InputError where it has none."""
    return StandingRows(robot) if robot.floating else ArmRows(robot)
