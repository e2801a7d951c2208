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
from excite.regressor.base_parameters import BaseParameters, structural_base_parameters
from excite.regressor.columns import DRIVE_TERMS, measured_columns
from excite.regressor.kernels import (
    base_link_regressor,
    forward_kinematics,
    inverse_dynamics,
    joint_torque_regressor,
)
from excite.regressor.tree import PRISMATIC, KinematicTree, read_tree
from excite.robot.joint_values import per_joint
from excite.robot.legs import TORQUE_SHARE
from excite.robot.robot import Robot
from excite.safety.checks.ground import ZMP_MARGIN
from excite.safety.checks.robustness import Facing, edges_of_support, faces_of_friction, shares_of_feet
from excite.safety.checks.sweep import Standing, Sweep
from excite.safety.ground_forces import wrench_at_world_origin
from excite.safety.parameter_set import RowsOfSet, WrenchRows, stated_parameters

# What designs keep of the distance from the edge beyond the check's [m], and the share of the friction, for what is
# between the samples and where feet share their load otherwise than at best; shares of either that count as much as a
# hundredth of a limit. Designs for TALOS with 5 mm and a thirtieth of the friction fall in rehearsal with a load, all
# of four, and slip by 20 to 44 mm without. With 25 mm and .3 of it two of two stand and slip by 1 and 10 mm, with half
# by less than 1 mm; a motion of 8.6 s gains 1062, 991 and 1010 nats, its source 448.
_EDGE_ROOM, _FRICTION_ROOM = 0.025, 0.5
_EDGE_UNIT, _FRICTION_UNIT = 0.02, 0.1
# Planes of the ground that are looked at, those that each sample is nearest to.
_NEAREST = 12


# Samples a second that information is of.
SEARCH_HZ = 24.0

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
        is_weighted: whether rows are divided by their noise.
        chosen: columns that stand for the base parameters; the first independent ones if None.
        noise: standard deviations of the rows' noise, ``(n_rows,)``; those that the description states if None.
    """

    robot: Robot
    terms: tuple[str, ...] = DRIVE_TERMS
    is_weighted: bool = True
    chosen: Indices | None = None
    noise: Array | None = None

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
        if not self.is_weighted:
            return np.ones(self.robot.n_equations)
        return 1.0 / (row_noise(self.robot) if self.noise is None else self.noise)

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

    def of_motion(self, motion: Motion) -> Array:
        """Information of a motion's samples at the rate of the search, ``(n_base, n_base)``."""
        sampled = motion.resampled(self.robot, SEARCH_HZ)
        return self.information(sampled.q, sampled.v, sampled.a)

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

    def watch(self, full: Array, state: Moved) -> None:
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
    that planes do not depend on the design. Torques of the legs' drives, which carry it, are looked at beside. Before
    each round the planes that are nearest at each sample are found anew, and of the stated set of robots the one that
    comes nearest to each: the slope of a largest value is that of whoever has it (Danskin 1967).

    Args:
        rows: of the robot.
        sampled: the source at the search's samples.

    Raises:
        InputError: a motion in which nothing can be said of the ground.
    """

    def __init__(self, rows: StandingRows, sampled: Motion) -> None:
        self._tree, self._regressor = rows.tree, rows.regressor
        robot, n = rows.robot, sampled.n_samples
        sweep = Sweep(robot, sampled, (n - 1) / sampled.duration)
        friction = min(foot.friction for foot in robot.feet)
        kinds = (
            (edges_of_support(sweep), ZMP_MARGIN, _EDGE_ROOM, _EDGE_UNIT),
            (faces_of_friction(sweep), 0.0, _FRICTION_ROOM * friction, _FRICTION_UNIT),
        )
        found = [_by_sample(facing, sampled, limit + room, unit) for facing, limit, room, unit in kinds]
        weight = robot.mass * float(np.linalg.norm(robot.model.gravity.linear))
        self._world = np.concatenate(found, axis=1) / weight
        self._edges, self._at_samples = self._world[:, : found[0].shape[1]], np.arange(n)[:, None]
        self._parameters = stated_parameters(robot)
        self._set = RowsOfSet(robot, self._parameters)
        self._members = [rows.tree.phi, *rows.members]
        self._legs, self._weight = LegTorques(rows, sweep, self._set), Weight(rows)
        # Where the source leaves less on the same feet, a design leaves as much to the same robots.
        state = Moved(sampled.q, sampled.v, sampled.a)
        full = rows.regressor(*state)
        self._most, self._others = np.ones((len(self._members), *self._world.shape[:2])), np.ones((n, 0))
        used = self.watch(full, state)
        others = self.values(full, state, sampled.v)[:, self._near.shape[1] :]
        standings, sizes = list(sweep.on_feet(np.arange(n))), [one.shape[1] for one in found]
        self._most = np.array([_most_on_same_feet(one, standings, sizes[:1]) for one in used])
        self._others = _most_on_same_feet(others, standings, sizes[:1])

    def values(self, full: Array, state: Moved, sign: Array) -> Array:
        """Shares that are used, 1 at the limits: of planes' room, of edges' at standstill, of the legs' torques."""
        self._forms = _in_base(self._world[self._at_samples, self._near], state.q)
        self._wrenches = self._worst @ full.transpose(0, 2, 1)
        used = [(self._forms * self._wrenches).sum(axis=2), self._weight.values(self._edges, state.q)]
        return np.hstack([np.maximum(1.0 + np.hstack(used), 0.0), self._legs.values(full, state, sign)])

    def pulled(self, slope: Array, full: Array, state: Moved, sign_slope: Array) -> Pulled:
        """Gradients of a sum of shares times ``slope``, where :meth:`values` was asked last."""
        n_near = self._near.shape[1]
        by_plane, by_edge, by_torque = np.split(slope, [n_near, n_near + self._edges.shape[1]], axis=1)
        legs, by_wrench = self._legs.pulled(by_torque, state, sign_slope)
        by_near, by_own = by_plane[:, :, None] * self._forms, _in_base(by_wrench, state.q)
        pulls = np.concatenate([by_near, by_own], axis=1)
        wrenches = np.concatenate([self._wrenches, (full @ self._tree.phi)[:, None]], axis=1)
        _pull_base(pulls, wrenches, state.q, legs.q)
        own = by_near.transpose(0, 2, 1) @ self._worst + by_own[:, 0, :, None] * self._tree.phi
        self._weight.pull((by_edge[:, :, None] * self._edges).sum(axis=1), state.q, legs.q)
        return legs._replace(weights=np.concatenate([own, legs.weights], axis=1))

    def watch(self, full: Array, state: Moved) -> Array:
        """Find the nearest planes and who comes nearest to them; shares of all planes, ``(n_robots, n, n_planes)``."""
        of_set, forms = self._set.of_wrench(state), _in_base(self._world, state.q)
        used = np.array([1.0 + np.einsum("nkw,nw->nk", forms, full @ phi) for phi in self._members])
        at = self._world @ of_set.of_wrench
        used[0] += self._parameters.rise(at)
        used = np.where(self._world.any(axis=2), used, -np.inf)
        beyond = used - self._most
        self._near = np.argsort(-beyond.max(axis=0), axis=1)[:, :_NEAREST]
        near = self._at_samples, self._near
        who = beyond.argmax(axis=0)[near]
        self.most = np.hstack([self._most[who, *near], self._others])
        self._worst = self._tree.phi + self._parameters.farthest(at[near])
        for i, phi in enumerate(self._members[1:], start=1):
            self._worst[who == i] = phi
        self._legs.watch(full, state, of_set)
        return np.asarray(used)


def _most_on_same_feet(used: Array, standings: Sequence[Standing], cuts: Sequence[int]) -> Array:
    """The most of shares ``(n, k)`` that is used on the same feet, by groups of columns, 1 at least."""
    most = np.ones_like(used)
    for standing in standings:
        for part in np.split(np.arange(used.shape[1]), cuts):
            own = np.ix_(standing.rows, part)
            most[own] = max(float(used[own].max()), 1.0)
    return most


def _world_wrench(base_wrench: Array, q: Array) -> Array:
    """A base's wrench ``(n, 6)`` about the world's origin, in its axes."""
    return wrench_at_world_origin(base_wrench, Rotation.from_quat(q[:, 3:7]).as_matrix(), q[:, :3])


def _in_base(forms: Array, q: Array) -> Array:
    """Forms of wrenches about the world's origin, ``(n, k, 6)``, as those of wrenches on the base in its axes."""
    rotation, (by_force, by_moment) = Rotation.from_quat(q[:, 3:7]).as_matrix(), np.split(forms, 2, axis=2)
    # n · f + m · (τ + p × f).
    about = by_force + np.cross(by_moment, q[:, None, :3])
    return np.concatenate([about @ rotation, by_moment @ rotation], axis=2)


def _pull_base(by_wrench: Array, wrench: Array, q: Array, by_q: Array) -> None:
    """Add gradients in the base's place and turn of forms ``(n, k, 6)`` of wrenches, both in the base's axes."""
    by_force, by_moment = np.split(by_wrench, 2, axis=2)
    force, moment = np.split(wrench, 2, axis=2)
    by_q[:, :3] += Rotation.from_quat(q[:, 3:7]).apply(np.cross(force, by_moment).sum(axis=1))
    by_q[:, 3:6] += (np.cross(force, by_force) + np.cross(moment, by_moment)).sum(axis=1)


class Weight:
    """The wrench about the world's origin of a robot that is stopped where it is: it acts below its centre of mass.

    Args:
        rows: of the robot.
    """

    def __init__(self, rows: StandingRows) -> None:
        self._tree, n = rows.tree, rows.tree.n_segments
        bodies = rows.tree.phi.reshape(n, 10)
        self._masses, self._moments = bodies[:, 0], bodies[:, 1:4]
        supports = rows.robot.model.supports
        self._carried = np.array(
            [[i + 1 in supports[j + 1] for j in range(n)] for i in range(n)], dtype=float
        )
        self._force = -self._masses.sum() * rows.robot.model.gravity.linear

    def values(self, forms: Array, q: Array) -> Array:
        """Of forms of wrenches about the world's origin ``(n, k, 6)``, ``(n, k)``."""
        self._poses = forward_kinematics(self._tree, q)
        place, turned = self._poses.translation[:, 1:], self._poses.rotation[:, 1:]
        moments = self._masses[:, None] * place + np.einsum("nbij,bj->nbi", turned, self._moments)
        self._levers = np.einsum("jb,nbi->nji", self._carried, moments)
        centre = self._levers[:, 0] / self._masses.sum()
        wrench = np.hstack([np.broadcast_to(self._force, centre.shape), np.cross(centre, self._force)])
        return np.asarray(np.einsum("nkw,nw->nk", forms, wrench))

    def pull(self, form: Array, q: Array, by_q: Array) -> None:
        """Add gradients of a form ``(n, 6)`` in the positions, where :meth:`values` was asked last."""
        joints, mass = np.arange(2, self._tree.n_segments + 1), self._masses.sum()
        by_centre = np.cross(self._force, form[:, 3:])
        by_q[:, :3] += by_centre
        about = np.cross(self._levers[:, 0] / mass - q[:, :3], by_centre)
        by_q[:, 3:6] += Rotation.from_quat(q[:, 3:7]).inv().apply(about)
        axis = np.einsum("njab,jb->nja", self._poses.rotation[:, joints], self._tree.axes[joints])
        carried = (self._carried @ self._masses)[joints - 1, None]
        arms = np.cross(axis, self._levers[:, joints - 1] - carried * self._poses.translation[:, joints])
        slides = self._tree.kinds[joints] == PRISMATIC
        arms[:, slides] = (carried * axis)[:, slides]
        by_q[:, joints + 4] += np.einsum("nji,ni->nj", arms, by_centre) / mass


class LegTorques:
    """Torques of the drives between the base and the feet, as shares of what motions use of their limits.

    Feet share changes of the wrench as they share it where they were looked at last.

    Args:
        rows: of the robot.
        sweep: the source at the search's samples.
        of_set: rows of the set that the description states.
    """

    def __init__(self, rows: StandingRows, sweep: Sweep, of_set: RowsOfSet) -> None:
        robot, self._tree, self._sweep, self._set = rows.robot, rows.tree, sweep, of_set
        self._parameters = stated_parameters(robot)
        self._chains = [np.array(list(robot.model.supports[foot.joint])[2:]) for foot in robot.feet]
        self._joints = rows.loaded_joints
        self._limits = TORQUE_SHARE * robot.limits.torque[self._joints - 2]
        self._more = [phi - rows.tree.phi for phi in rows.members]
        self._drives = stated_drives(robot)[:, self._joints - 2]

    def watch(self, full: Array, state: Moved, of_set: WrenchRows) -> None:
        """Find how feet share the wrench, and what the set and members take of the torques."""
        wrench, *more = (_world_wrench(full @ phi, state.q) for phi in (self._tree.phi, *self._more))
        self._shares = shares_of_feet(self._sweep, np.arange(len(full)), wrench)
        rows = self._set.of_torques(state, of_set, self._shares)[:, self._joints - 2]
        added = [self._torques(*one, state) for one in zip(more, self._more, strict=True)]
        rise, fall = self._parameters.rise(rows), self._parameters.rise(rows, -1.0)
        self._rises = np.max([rise, *added], axis=0), np.max([fall, *(-one for one in added)], axis=0)

    def _torques(self, wrench: Array, phi: Array, state: Moved) -> Array:
        """Without friction and inertia of the drives, ``(n, n_loaded_joints)`` [N·m]."""
        torques, poses = inverse_dynamics(self._tree, *state, phi), forward_kinematics(self._tree, state.q)
        self._legs: list[tuple[NDArray[np.intp], Array, Array, Array, Array, Array]] = []
        for chain, share in zip(self._chains, self._shares.transpose(1, 0, 2, 3), strict=True):
            axis = np.einsum("njab,jb->nja", poses.rotation[:, chain], self._tree.axes[chain])
            place = poses.translation[:, chain]
            force, moment = np.split(np.einsum("nij,nj->ni", share, wrench)[:, None], 2, axis=2)
            about = moment - np.cross(place, force)
            torques[:, chain + 4] -= (axis * about).sum(axis=2)
            self._legs.append((chain, share, axis, place, force, about))
        return torques[:, self._joints + 4]

    def values(self, full: Array, state: Moved, sign: Array) -> Array:
        """Shares ``(n, n_loaded_joints)``."""
        at, (viscous, coulomb, armature) = self._joints + 4, self._drives
        found = self._torques(_world_wrench(full @ self._tree.phi, state.q), self._tree.phi, state)
        found = found + viscous * state.v[:, at] + coulomb * sign[:, at] + armature * state.a[:, at]
        upper, lower = found + self._rises[0], self._rises[1] - found
        self._sign = np.where(upper >= lower, 1.0, -1.0) / self._limits
        return np.asarray(np.maximum(np.maximum(upper, lower) / self._limits, 0.0))

    def pulled(self, slope: Array, state: Moved, sign_slope: Array) -> tuple[Pulled, Array]:
        """Gradients of a sum of shares times ``slope``, and in the wrench about the world's origin ``(n, 1, 6)``,
        where :meth:`values` was asked last."""
        viscous, coulomb, armature = self._drives
        slope, at = slope * self._sign, self._joints + 4
        by_q, by_v, by_a = np.zeros((3, *state.v.shape))
        by_v[:, at] = slope * (viscous + coulomb * sign_slope[:, at])
        by_a[:, at] = slope * armature
        by_wrench, turn = np.zeros((len(slope), 6)), Rotation.from_quat(state.q[:, 3:7]).inv()
        by_torque = np.zeros_like(by_q)
        by_torque[:, at] = -slope
        for chain, share, axis, place, force, about in self._legs:
            own = by_torque[:, chain + 4, None]
            screws = np.concatenate([np.cross(place, axis), axis], axis=2) * own
            by_wrench += np.einsum("nji,nj->ni", share, screws.sum(axis=1))
            # What turns a joint's axis and shifts its place, of all that come after another.
            by_axis, by_place = own * about, -own * np.cross(force, axis)
            turning = np.cross(axis, by_axis) + np.cross(place, by_place)
            turning, shifting = (np.flip(np.cumsum(np.flip(one, 1), 1), 1) for one in (turning, by_place))
            by_q[:, :3] += shifting[:, 0]
            by_q[:, 3:6] += turn.apply(turning[:, 0] - np.cross(state.q[:, :3], shifting[:, 0]))
            # A joint turns nothing of its own: neither its axis nor its place.
            by_q[:, chain[:-1] + 4] += (
                axis[:, :-1] * (turning[:, 1:] - np.cross(place[:, :-1], shifting[:, 1:]))
            ).sum(axis=2)
        return Pulled(slope[:, :, None] * self._tree.phi, by_v, by_a, by_q), by_wrench[:, None]


def _by_sample(facing: Facing | None, sampled: Motion, room: float, unit: float) -> Array:
    """Planes of every sample about the world's origin, ``(n, n_planes, 6)``; those that are none are zero."""
    if facing is None:
        raise InputError("stands on no area at times", source=sampled.name, remedy="use another motion")
    found = np.zeros((sampled.n_samples, max(planes.shape[1] for planes in facing.planes), 6))
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


def design_rows(robot: Robot, members: Sequence[Array] = (), noise: Array | None = None) -> DesignRows:
    """Rows to design a robot's motions with; raises InputError where it has none.

    Args:
        robot: the robot.
        members: parameters of robots that have to stand too, ``(10·n_segments,)`` each.
        noise: as of :class:`DesignRows`.
    """
    return (
        StandingRows(robot, noise=noise, members=tuple(members))
        if robot.floating
        else ArmRows(robot, noise=noise)
    )


def can_design(robot: Robot) -> bool:
    """Whether there are rows to design a robot's motions with."""
    try:
        design_rows(robot)
    except InputError:
        return False
    return True
