"""What motions are designed with: weighted rows of base parameters, what else bounds a motion, and the ways back.

An arm's rows are its joint torques, and its drives bound it; a robot's on wrench sensors are those of the whole wrench,
and the ground bounds it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from excite.arrays import Array, Indices, Moved
from excite.errors import InputError
from excite.excitation.design_coordinates import FeetCoordinates, JointCoordinates, can_hold_feet
from excite.excitation.precision import nominal_values, row_noise
from excite.excitation.targets import NEGLIGIBLE
from excite.motion.generators.generator import free_upper_body, upper_body
from excite.motion.motion import Motion
from excite.regressor.adjoint import regressor_gradient
from excite.regressor.base_parameters import BaseParameters, structural_base_parameters
from excite.regressor.columns import DRIVE_TERMS, measured_columns
from excite.regressor.kernels import (
    Placements,
    base_link_regressor,
    forward_kinematics,
    inverse_dynamics,
    joint_torque_regressor,
)
from excite.regressor.tree import KinematicTree, read_tree
from excite.robot.joint_values import per_joint
from excite.robot.legs import TORQUE_SHARE
from excite.robot.robot import Robot
from excite.safety.checks.ground import ZMP_MARGIN
from excite.safety.checks.robustness import Facing, edges_of_support, faces_of_friction, shares_of_feet
from excite.safety.checks.sweep import Sweep
from excite.safety.ground_forces import wrench_at_world_origin
from excite.safety.parameter_set import RowsOfSet, WrenchRows, stated_parameters

# What designs keep of the distance from the edge beyond the check's [m], and the share of the friction, for what is
# between the samples and where feet share their load otherwise than at best; shares of either that count as much as a
# hundredth of a limit. Designs for TALOS with 5 mm and a thirtieth of the friction fall in rehearsal with a load, all
# of four, and slip by 20 to 44 mm without. With 25 mm and .3 of it two of two stand and slip by 1 and 10 mm, with half
# by less than 1 mm; a motion of 8.6 s gains 1062, 991 and 1010 nats, its source 448.
_EDGE_ROOM, _FRICTION_ROOM = 0.025, 0.5
_EDGE_UNIT, _FRICTION_UNIT = 0.02, 0.1


_NOTHING = np.zeros(1)


class Pulled(NamedTuple):
    """Gradients of a criterion through the rows of an arm.

    Attributes:
        weights: of the regressor's entries ``(n, n_joints, size)``.
        v: through the drives' terms, in the velocities ``(n, n_joints)``.
        a: in the accelerations ``(n, n_joints)``.
        q: in positions ``(n, nv)``, of a free base its place in the world's axes and its turn about its own.
    """

    weights: Array
    v: Array
    a: Array
    q: Array = _NOTHING


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

    @property
    def prior(self) -> Array:
        """Information that is there before any motion, ``(n_base, n_base)``."""
        return np.zeros((len(self.independent), len(self.independent)))

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

    @cached_property
    def loaded_joints(self) -> NDArray[np.intp]:
        """Joints of the model between a free base and the feet that stand."""
        chains = [np.array(list(self.robot.model.supports[foot.joint])[2:]) for foot in self.robot.feet]
        return np.unique(np.concatenate(chains)) if chains else np.zeros(0, dtype=np.intp)

    def coordinates(self, motion: Motion) -> JointCoordinates:
        """What designs add to a motion's samples."""
        return JointCoordinates(self.robot, self.moved, motion)

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
        """As of :func:`stated_drives`."""
        return stated_drives(self.robot)

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

    def values(self, full: Array, state: Moved, sign: Array) -> Array:
        """Torques ``(n, n_joints)`` [N·m or N]."""
        return self.rows.torques(full, state.v, state.a, sign)

    def pulled(self, slope: Array, full: Array, state: Moved, sign_slope: Array) -> Pulled:
        """Gradients of a sum of torques times ``slope``, ``(n, n_joints)``."""
        viscous, coulomb, armature = self.rows.drives
        weights = slope[:, :, None] * self.rows.tree.phi
        return Pulled(weights, slope * (viscous + coulomb * sign_slope), slope * armature)

    def watch(self, state: Moved) -> None:
        """Nothing is to be found anew."""


@dataclass(frozen=True, eq=False)
class StandingRows(DesignRows):
    """The weighted regressor of a robot's whole wrench, as its feet's sensors sum it.

    Designs move the base and the joints in no leg, and legs of six joints follow so that feet go as in the source; with
    other legs the joints that no foot needs. What the ground can give is bounded, for every robot of the set that the
    description states.

    Attributes:
        robot: a robot on wrench sensors.
        members: parameters ``(10·n_segments,)`` that ground and legs have to carry beside those of the stated set.
    """

    members: tuple[Array, ...] = ()

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
        if can_hold_feet(self.robot):
            return np.arange(self.robot.n_joints)
        return np.flatnonzero(free_upper_body(self.robot))

    def coordinates(self, motion: Motion) -> JointCoordinates:
        """What designs add to a motion's samples."""
        if can_hold_feet(self.robot):
            return FeetCoordinates(self.robot, np.flatnonzero(upper_body(self.robot)), motion)
        return super().coordinates(motion)

    @cached_property
    def _columns(self) -> Indices:
        return self._inertial[self.independent]

    @property
    def prior(self) -> Array:
        """Values are known to ten times their size, which matters where no source turns the base."""
        size = 10.0 * np.maximum(np.abs(nominal_values(self.robot, self.base)), NEGLIGIBLE)
        return np.diag(1.0 / size**2)

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
        return Pulled(weights, _NOTHING, _NOTHING)


class GroundForces:
    """How near the whole wrench comes to what soles can give: the edge of their polygon, and friction.

    Both are planes that the wrench stays below (:mod:`excite.safety.checks.robustness`); feet go as in the source, so
    that planes do not depend on the design. Torques of the legs' drives, which carry it, are looked at beside. What the
    stated set of robots takes of the room is found anew before each round.

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
        friction = min(foot.friction for foot in robot.feet)
        kinds = (
            (edges_of_support(sweep), ZMP_MARGIN, _EDGE_ROOM, _EDGE_UNIT),
            (faces_of_friction(sweep), 0.0, _FRICTION_ROOM * friction, _FRICTION_UNIT),
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
        self._n_edges = found[0].shape[1]
        self._rise: Array = np.zeros(self._world.shape[:2])
        self._more = [phi - rows.tree.phi for phi in rows.members]
        self._legs = LegTorques(rows, sweep)
        # Where the source leaves less on the same feet, a design leaves as much.
        state = Moved(sampled.q, sampled.v, sampled.a)
        self.watch(state)
        used = self.values(rows.regressor(*state), state, sampled.v)
        groups = np.cumsum([*(one.shape[1] for one in found), self._n_edges])
        self.most = np.ones_like(used)
        for standing in sweep.on_feet(np.arange(n)):
            for part in np.split(np.arange(used.shape[1]), groups):
                own = np.ix_(standing.rows, part)
                self.most[own] = max(float(used[own].max()), 1.0)

    def values(self, full: Array, state: Moved, sign: Array) -> Array:
        """Shares that are used, 1 at the limits: of planes' room, of edges' at standstill, of the legs' torques."""
        wrench, still = _world_wrench(full @ self._tree.phi, state.q), self._standstill(state)
        planes = np.einsum("nkw,nw->nk", self._world, wrench) + self._rise
        edges = np.einsum("nkw,nw->nk", self._world[:, : self._n_edges], still)
        room = np.maximum(1.0 + np.hstack([planes, edges]), 0.0)
        return np.hstack([room, self._legs.values(wrench, state, sign)])

    def _standstill(self, state: Moved) -> Array:
        """The wrench of a robot that is stopped there, ``(n, 6)``: it acts below the centre of mass."""
        none = np.zeros_like(state.v)
        return _world_wrench(inverse_dynamics(self._tree, state.q, none, none)[:, :6], state.q)

    def pulled(self, slope: Array, full: Array, state: Moved, sign_slope: Array) -> Pulled:
        """Gradients of a sum of shares times ``slope``."""
        wrench, none, n_planes = (
            _world_wrench(full @ self._tree.phi, state.q),
            np.zeros_like(state.v),
            self._world.shape[1],
        )
        by_plane, by_edge, by_torque = np.split(slope, [n_planes, n_planes + self._n_edges], axis=1)
        legs, by_wrench = self._legs.pulled(by_torque, wrench, state, sign_slope)
        own = self._by_base(by_wrench + np.einsum("nk,nkw->nw", by_plane, self._world), wrench, state, legs.q)
        by_still = np.einsum("nk,nkw->nw", by_edge, self._world[:, : self._n_edges])
        still = self._by_base(by_still, self._standstill(state), state, legs.q)
        legs.q[:] += regressor_gradient(self._tree, state.q, none, none, still).q
        return legs._replace(weights=np.concatenate([own, legs.weights], axis=1))

    def _by_base(self, by_wrench: Array, wrench: Array, state: Moved, by_q: Array) -> Array:
        """Weights ``(n, 6, size)`` of the base's rows; gradients in its place and turn are added to ``by_q``."""
        by_force, by_moment = np.split(by_wrench, 2, axis=1)
        force, moment = np.split(wrench, 2, axis=1)
        place, turn = state.q[:, :3], Rotation.from_quat(state.q[:, 3:7]).inv()
        # About the base: n · f + m · (τ + p × f).
        about = by_force + np.cross(by_moment, place)
        turning = np.cross(force, about) + np.cross(moment - np.cross(place, force), by_moment)
        by_q[:, :3] += np.cross(force, by_moment)
        by_q[:, 3:6] += turn.apply(turning)
        return np.hstack([turn.apply(about), turn.apply(by_moment)])[:, :, None] * self._tree.phi

    def watch(self, state: Moved) -> None:
        """Find what the set of robots takes of the room."""
        of_set = self._set.of_wrench(state)
        n, k = self._rise.shape
        samples = np.repeat(np.arange(n), k)
        rise = self._parameters.rise_of_forms(self._world.reshape(n * k, 6), samples, of_set.of_wrench)
        wrenches = [
            _world_wrench(inverse_dynamics(self._tree, *state, phi)[:, :6], state.q)
            for phi in (self._tree.phi, *self._more)
        ]
        more = [np.einsum("nkw,nw->nk", self._world, wrench) for wrench in wrenches[1:]]
        self._rise = np.max([rise.reshape(n, k), *more], axis=0)
        self._legs.watch(wrenches, state, of_set)


def _world_wrench(base_wrench: Array, q: Array) -> Array:
    """A base's wrench ``(n, 6)`` about the world's origin, in its axes."""
    return wrench_at_world_origin(base_wrench, Rotation.from_quat(q[:, 3:7]).as_matrix(), q[:, :3])


class LegTorques:
    """Torques of the drives between the base and the feet, as shares of what motions use of their limits.

    Feet share changes of the wrench as they share it where they were looked at last.

    Args:
        rows: of the robot.
        sweep: the source at the search's samples.
    """

    def __init__(self, rows: StandingRows, sweep: Sweep) -> None:
        robot, self._tree, self._sweep = rows.robot, rows.tree, sweep
        self._parameters = stated_parameters(robot)
        self._set = RowsOfSet(robot, self._parameters)
        self._chains = [np.array(list(robot.model.supports[foot.joint])[2:]) for foot in robot.feet]
        self._joints = rows.loaded_joints
        self._limits = TORQUE_SHARE * robot.limits.torque[self._joints - 2]
        self._more = [phi - rows.tree.phi for phi in rows.members]
        self._drives = stated_drives(robot)[:, self._joints - 2]

    def watch(self, wrenches: Sequence[Array], state: Moved, of_set: WrenchRows) -> None:
        """Find how feet share the wrench ``(n, 6)``, the first, and what the set and members take of the torques.

        The other wrenches are what members add.
        """
        self._shares = shares_of_feet(self._sweep, np.arange(len(wrenches[0])), wrenches[0])
        rows = self._set.of_torques(state, of_set, self._shares)[:, self._joints - 2]
        added = [self._torques(*one, state) for one in zip(wrenches[1:], self._more, strict=True)]
        rise, fall = self._parameters.rise(rows), self._parameters.rise(rows, -1.0)
        self._rises = np.max([rise, *added], axis=0), np.max([fall, *(-one for one in added)], axis=0)

    def _torques(self, wrench: Array, phi: Array, state: Moved) -> Array:
        """Without friction and inertia of the drives, ``(n, n_loaded_joints)`` [N·m]."""
        torques = inverse_dynamics(self._tree, *state, phi)
        poses = forward_kinematics(self._tree, state.q)
        for chain, share in zip(self._chains, self._shares.transpose(1, 0, 2, 3), strict=True):
            axis, place = self._axes(poses, chain)
            force, moment = np.split(np.einsum("nij,nj->ni", share, wrench)[:, None], 2, axis=2)
            torques[:, chain + 4] -= (axis * (moment - np.cross(place, force))).sum(axis=2)
        return torques[:, self._joints + 4]

    def values(self, wrench: Array, state: Moved, sign: Array) -> Array:
        """Shares ``(n, n_loaded_joints)`` for a wrench about the world's origin, ``(n, 6)``."""
        at, (viscous, coulomb, armature) = self._joints + 4, self._drives
        found = self._torques(wrench, self._tree.phi, state)
        found = found + viscous * state.v[:, at] + coulomb * sign[:, at] + armature * state.a[:, at]
        upper, lower = found + self._rises[0], self._rises[1] - found
        self._sign = np.where(upper >= lower, 1.0, -1.0) / self._limits
        return np.asarray(np.maximum(np.maximum(upper, lower) / self._limits, 0.0))

    def _axes(self, poses: Placements, joints: NDArray[np.intp]) -> tuple[Array, Array]:
        """Axes and places of joints in the world, ``(n, k, 3)`` each."""
        axis = np.einsum("njab,jb->nja", poses.rotation[:, joints], self._tree.axes[joints])
        return axis, poses.translation[:, joints]

    def pulled(self, slope: Array, wrench: Array, state: Moved, sign_slope: Array) -> tuple[Pulled, Array]:
        """Gradients of a sum of shares times ``slope``, and those in the wrench ``(n, 6)``."""
        viscous, coulomb, armature = self._drives
        slope, at = slope * self._sign, self._joints + 4
        by_q, by_v, by_a = np.zeros((3, *state.v.shape))
        by_v[:, at] = slope * (viscous + coulomb * sign_slope[:, at])
        by_a[:, at] = slope * armature
        by_wrench = np.zeros_like(wrench)
        poses, turn = forward_kinematics(self._tree, state.q), Rotation.from_quat(state.q[:, 3:7]).inv()
        by_torque = np.zeros_like(by_q)
        by_torque[:, at] = -slope
        for chain, share in zip(self._chains, self._shares.transpose(1, 0, 2, 3), strict=True):
            axis, place = self._axes(poses, chain)
            force, moment = np.split(np.einsum("nij,nj->ni", share, wrench)[:, None], 2, axis=2)
            own = by_torque[:, chain + 4, None]
            screws = np.concatenate([np.cross(place, axis), axis], axis=2) * own
            by_wrench += np.einsum("nji,nj->ni", share, screws.sum(axis=1))
            # What turns a joint's axis and shifts its place, of all that come after another.
            by_axis, by_place = own * (moment - np.cross(place, force)), -own * np.cross(force, axis)
            turning = np.cross(axis, by_axis) + np.cross(place, by_place)
            turning, shifting = (np.flip(np.cumsum(np.flip(one, 1), 1), 1) for one in (turning, by_place))
            by_q[:, :3] += shifting[:, 0]
            by_q[:, 3:6] += turn.apply(turning[:, 0] - np.cross(state.q[:, :3], shifting[:, 0]))
            # A joint turns nothing of its own: neither its axis nor its place.
            by_q[:, chain[:-1] + 4] += (
                axis[:, :-1] * (turning[:, 1:] - np.cross(place[:, :-1], shifting[:, 1:]))
            ).sum(axis=2)
        return Pulled(slope[:, :, None] * self._tree.phi, by_v, by_a, by_q), by_wrench


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


def stated_drives(robot: Robot) -> Array:
    """Viscous and Coulomb friction and rotor inertia that the description states, ``(3, n_joints)`` [SI]."""
    drives, nothing = robot.description.drives, np.zeros(robot.n_joints)
    blocks = (drives.viscous, drives.coulomb, drives.armature)
    return np.array([per_joint(block, robot.joint_names, nothing) for block in blocks])


def design_rows(robot: Robot, members: Sequence[Array] = ()) -> DesignRows:
    """Rows to design a robot's motions with; raises InputError where it has none.

    Args:
        robot: the robot.
        members: parameters of robots that have to stand too, ``(10·n_segments,)`` each.
    """
    return StandingRows(robot, members=tuple(members)) if robot.floating else ArmRows(robot)
