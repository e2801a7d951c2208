"""What a hypothesis makes of a record: the base wrench that is then measured less the one predicted."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.effects.friction import CoulombFriction, ViscousFriction
from excite.diagnosis.effects.gears.gear_effect import Armature
from excite.diagnosis.effects.readings import TorqueBias
from excite.diagnosis.floating.record import TORQUE, FloatingRecord
from excite.errors import LogError
from excite.logs.columns import WRENCH_AXES
from excite.regressor.contact_forces import carried_wrench, tree_contact_maps
from excite.regressor.kernels import (
    Placements,
    base_link_regressor,
    forward_kinematics,
    inverse_dynamics,
    joint_torque_regressor,
)
from excite.regressor.tree import KinematicTree
from excite.rows.drive_terms import smooth_sign

_DEPENDS = {
    "poses": "tree q",
    "reading_levers": "tree q placements",
    "contact_maps": "tree q",
    "drive_term_shapes": "v a",
    "measured_forces": "tree q readings placements",
    "measured_phi": "phi",
    "predicted_forces": "tree q v a phi drives",
    "regressor": "tree q v a",
    "smooth_torques": "tree q v a phi readings placements",
    "joint_torques": "tree q v a phi readings placements",
    "turn_cache": "tree q v a phi placements",
    "unit_mass_cache": "tree q v a",
}


@dataclass(frozen=True, eq=False)
class State:
    """Robot, motion and readings as a hypothesis says they truly were; effects replace fields of it.

    Attributes:
        record: what was logged.
        tree: kinematics; its ``rotations`` and ``translations`` may be replaced.
        q: ``(n, nq)``.
        v: ``(n, nv)``.
        a: ``(n, nv)``.
        phi: ``(10·n_segments,)`` inertial parameters, those beyond the sensors included.
        readings: by sensor, ``(n, 6)`` true contact wrench in the sensor's frame.
        placements: by sensor, its pose in the frame of its joint (of the world for a plate).
        extra: ``(n, 6)`` further wrench on the robot at the base, base frame.
    """

    record: FloatingRecord
    tree: KinematicTree
    q: Array
    v: Array
    a: Array
    phi: Array
    readings: dict[str, Array]
    placements: dict[str, pin.SE3]
    extra: Array | float = field(default=0.0)

    @classmethod
    def from_log(cls, record: FloatingRecord, phi: Array | None = None) -> Self:
        """The state in which the log and the nominal model are right."""
        return cls(
            record=record,
            tree=record.tree,
            q=record.q,
            v=record.v,
            a=record.a,
            phi=record.tree.phi if phi is None else phi,
            readings=record.readings,
            placements={s.name: s.placement for s in record.robot.sensors},
        )

    def replace(self, **changes: Any) -> Self:
        """A copy with fields replaced; what was computed and does not depend on them is kept."""
        other, changed = dataclasses.replace(self, **changes), set(changes)
        # The base's equation holds nothing of segments beyond the sensors.
        if "phi" in changed and np.array_equal(other.measured_phi, self.measured_phi):
            changed.remove("phi")
        # Whoever finds a joint's turn or a segment's load first, all states of the same motion have it.
        self.__dict__.setdefault("turn_cache", {})
        self.__dict__.setdefault("unit_mass_cache", {})
        for name, depends in _DEPENDS.items():
            if name in self.__dict__ and changed.isdisjoint(depends.split()):
                other.__dict__[name] = self.__dict__[name]
        return other

    def move_joint(self, joint: int, **changes: Array | float) -> Self:
        """The state with ``(n,)`` added to a joint's position ``q``, velocity ``v`` or acceleration ``a``."""
        made = {}
        for name, change in changes.items():
            made[name] = getattr(self, name).copy()
            made[name][:, (self.tree.idx_q if name == "q" else self.tree.idx_v)[joint]] += change
        return self.replace(**made)

    @cached_property
    def poses(self) -> Placements:
        """World poses of all joints."""
        return forward_kinematics(self.tree, self.q)

    @cached_property
    def measured_forces(self) -> Array:
        """``(n, 6)`` sum of the contact wrenches at the base's origin, base frame (Jovic et al. 2015, eq. 2)."""
        parts = [
            np.einsum("nij,nj->ni", lever, self.readings[name]) for name, lever in self.reading_levers.items()
        ]
        return np.sum(parts, axis=0)

    @cached_property
    def reading_levers(self) -> dict[str, Array]:
        """By sensor, ``(n, 6, 6)``: its reading's wrench at the base's origin, base frame."""
        levers = {}
        for sensor in self.record.robot.sensors:
            placement = self.placements[sensor.name]
            axes = self.poses.rotation[:, sensor.joint] @ placement.rotation
            force = self.at_base(axes, self.poses.point(sensor.joint, placement.translation))
            moment = np.concatenate([np.zeros_like(axes), force[:, :3]], axis=1)
            levers[sensor.name] = np.concatenate([force, moment], axis=2)
        return levers

    def at_base(self, force: Array, point: Array) -> Array:
        """Wrench ``(n, 6)`` at the base's origin, base frame, of world ``force (n, 3)`` at ``point (n, 3)``.

        Of ``k`` forces at each point, ``(n, 3, k)``, as many wrenches: ``(n, 6, k)``.
        """
        turned = np.concatenate([force, cross_rows(point - self.poses.translation[:, 1], force)], axis=1)
        parts = turned.reshape(len(turned), 2, 3, -1)
        return np.einsum("nji,npjk->npik", self.poses.rotation[:, 1], parts).reshape(turned.shape)

    @cached_property
    def measured_phi(self) -> Array:
        """Inertial parameters with those of unmeasured segments set to zero."""
        phi = self.phi.copy()
        for segment in self.record.unmeasured:
            phi[10 * segment : 10 * segment + 10] = 0.0
        return phi

    @cached_property
    def predicted_forces(self) -> Array:
        """``(n, 6)`` wrench that the motion needs, base frame."""
        return inverse_dynamics(self.tree, self.q, self.v, self.a, self.measured_phi)[:, :6]

    @property
    def residual(self) -> Array:
        """``(n, 6)`` measured plus further wrenches less predicted [N, N·m]."""
        return self.measured_forces + self.extra - self.predicted_forces

    @cached_property
    def regressor(self) -> Array:
        """``(n, 6, 10·n_segments)`` of the wrench, columns of unmeasured segments zero."""
        body = base_link_regressor(self.tree, self.q, self.v, self.a)
        for segment in self.record.unmeasured:
            body[:, :, 10 * segment : 10 * segment + 10] = 0.0
        return body

    @cached_property
    def turn_cache(self) -> dict[int, Any]:
        """By joint, the derivatives that ``joint_turn`` has found for this motion; a store that it alone reads."""
        return {}

    def is_moved_by(self, joint: int, name: str) -> bool:
        """Whether the turn of a joint moves what a reading acts on."""
        sensors = {sensor.name: sensor.joint for sensor in self.record.robot.sensors}
        return name not in sensors or sensors[name] in subtree_joints(self.tree.parents, joint)

    @cached_property
    def unit_mass_cache(self) -> dict[int, Array]:
        """By segment, what :meth:`on_unit_mass` has found for this motion."""
        return {}

    def on_unit_mass(self, segment: int, place: Array) -> Array:
        """``(n, 3)`` force on a unit mass that moves with a segment: acceleration less gravity, world [m/s²].

        Args:
            segment: its index.
            place: ``(3,)`` of the mass, in the frame of the segment's joint [m].
        """
        if segment not in self.unit_mass_cache:
            forces = [self._on_unit_mass(segment, corner) for corner in (np.zeros(3), *np.eye(3))]
            self.unit_mass_cache[segment] = np.stack(
                [forces[0], *(f - forces[0] for f in forces[1:])], axis=2
            )
        # Accelerations of points of a body are affine in their place.
        return np.asarray(self.unit_mass_cache[segment] @ np.concatenate([[1.0], place]))

    def _on_unit_mass(self, segment: int, place: Array) -> Array:
        phi = np.zeros_like(self.phi)
        # The force, unlike the moment, does not depend on moments of inertia.
        phi[10 * segment : 10 * segment + 4] = (1.0, *place)
        force = inverse_dynamics(self.tree, self.q, self.v, self.a, phi)[:, :3]
        return np.einsum("nij,nj->ni", self.poses.rotation[:, 1], force)

    @cached_property
    def joint_torques(self) -> Array:
        """``(n, nv)`` torque that each joint carries, contact wrenches taken into account [N·m]."""
        torque = inverse_dynamics(self.tree, self.q, self.v, self.a, self.measured_phi)
        for sensor in self.record.robot.sensors:
            placement, wrench = self.placements[sensor.name], self.readings[sensor.name]
            rotation = self.poses.rotation[:, sensor.joint] @ placement.rotation
            force = np.einsum("nij,nj->ni", rotation, wrench[:, :3])
            moment = np.einsum("nij,nj->ni", rotation, wrench[:, 3:])
            point = self.poses.point(sensor.joint, placement.translation)
            joint = sensor.joint or self.record.robot.foot(sensor.foot).joint
            while joint > 1:
                axis = self.poses.rotation[:, joint] @ self.tree.axes[joint]
                arm = cross_rows(point - self.poses.translation[:, joint], force) + moment
                torque[:, self.tree.idx_v[joint]] -= np.einsum("ni,ni->n", axis, arm)
                joint = int(self.tree.parents[joint])
        return torque

    @cached_property
    def smooth_torques(self) -> Array:
        """The same without what is above 4 Hz, where they hold noise of accelerations."""
        return self._smooth_signal(self.joint_torques)

    def smooth_torque(self, iv: int) -> Array:
        """``(n,)`` the same of one joint, by its index in the velocities, where no other is asked for."""
        return self._smooth_signal(self.joint_torques[:, iv])

    def _smooth_signal(self, values: Array) -> Array:
        return self.record.smooth_signal(values, 4.0)

    @property
    def channel_units(self) -> dict[str, str]:
        """Unit of each row, by name."""
        return dict(zip(WRENCH_AXES, ("N",) * 3 + ("N·m",) * 3, strict=True))

    @property
    def white_noise(self) -> Array:
        """``(c, c)`` covariance of the rows' white noise, a sample of the full rate."""
        return self.record.sensor_noise

    @property
    def n_drive_terms(self) -> int:
        """Number of the drives' own parameters: a base's wrench holds none."""
        return 0

    def with_errors(self, delta: Array) -> State:
        """The state with errors ``(10·n_segments,)`` of the inertial parameters."""
        return self.replace(phi=self.record.tree.phi + delta)

    def free_errors(self) -> FreeParameters:
        """What is identified along, and what one expects of its errors before looking at data."""
        return inertial_errors(self)


class FreeParameters(NamedTuple):
    """Parameters that are identified along.

    Attributes:
        columns: ``(n, c, p)`` of the rows, per unit of each.
        scales: ``(p,)`` standard deviation that is expected of its error.
        at: ``(p,)`` its place among all errors of a state.
    """

    columns: Array
    scales: Array
    at: NDArray[np.int64]

    def join_with(self, other: FreeParameters) -> FreeParameters:
        """These and others."""
        parts = zip(self, other, strict=True)
        return FreeParameters(*(np.concatenate([one, two], axis=-1) for one, two in parts))


def inertial_errors(state: State) -> FreeParameters:
    """The inertial parameters of measured segments, where the log has them identified."""
    own = inertial_scales(state.record.tree.phi)
    for segment in state.record.unmeasured:
        own[10 * segment : 10 * segment + 10] = 0.0
    free = np.flatnonzero(own) if state.record.inertials_free else np.zeros(0, dtype=np.int64)
    return FreeParameters(state.regressor[:, :, free], own[free], free)


# What one expects of inertial parameters before looking at data.

_SHARE, _ARM_M = 0.3, 0.04


def inertial_scales(phi: Array) -> Array:
    """Standard deviation of the error of each nominal parameter, ``(10·n,)`` as ``phi``.

    Three tenths of a mass and of moments of inertia, and a few centimetres of the centre of mass: loose, so
    that data decide wherever they say anything, and blind directions stay nominal.
    """
    scales = np.empty_like(phi)
    table, out = phi.reshape(-1, 10), scales.reshape(-1, 10)
    mass = table[:, 0]
    inertia = np.abs(table[:, [4, 6, 9]]).sum(axis=1)
    out[:, 0] = _SHARE * mass
    out[:, 1:4] = (_ARM_M * mass + _SHARE * np.abs(table[:, 1:4]).max(axis=1))[:, None]
    out[:, 4:] = (_SHARE * inertia + _ARM_M**2 * mass)[:, None]
    return scales


# Cross products of many vectors.


def cross_rows(vector: Array, other: Array) -> Array:
    """``vector (n, 3) × other``, the latter ``(n, 3)``, or ``(n, 3, k)`` for columns.

    For the thousands of small arrays of a search, where numpy's own spends its time on moving axes.
    """
    x, y, z = vector.T if other.ndim == 2 else vector.T[:, :, None]
    a, b, c = other[:, 0], other[:, 1], other[:, 2]
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=1)


# How the residual changes when a joint's position, velocity and acceleration do.

# The residual is linear in accelerations and quadratic in velocities; positions turn sines and cosines.
_STEP_Q, _STEP_V, _STEP_A = 1e-4, 1e-3, 1.0


@dataclass(frozen=True, eq=False)
class JointTurn:
    """Derivatives of the residual, each ``(n, 6)``, with respect to one joint's motion at each instant.

    Attributes:
        state: where to linearise; its readings do not matter.
        joint: index in the tree.
    """

    state: State
    joint: int

    def by_q(self, readings: dict[str, Array]) -> Array:
        """With respect to its position; sensors that it carries turn too, and what they read.

        Args:
            readings: by sensor, ``(n, 6)``.
        """
        change, levers = self._by_q
        for name, lever in levers.items():
            change = change + np.einsum("nij,nj->ni", lever, readings[name])
        return change

    @cached_property
    def _by_q(self) -> tuple[Array, dict[str, Array]]:
        """Of minus the predicted wrench; of the levers of the sensors that it carries."""
        turned = self.state.move_joint(self.joint, q=_STEP_Q)
        levers = {
            name: (turned.reading_levers[name] - lever) / _STEP_Q
            for name, lever in self.state.reading_levers.items()
            if self.state.is_moved_by(self.joint, name)
        }
        return (self.state.predicted_forces - turned.predicted_forces) / _STEP_Q, levers

    @cached_property
    def by_v(self) -> Array:
        """With respect to its velocity."""
        moved = self.state.move_joint(self.joint, v=_STEP_V)
        return (self.state.predicted_forces - moved.predicted_forces) / _STEP_V

    @cached_property
    def by_a(self) -> Array:
        """With respect to its acceleration."""
        moved = self.state.move_joint(self.joint, a=_STEP_A)
        return (self.state.predicted_forces - moved.predicted_forces) / _STEP_A

    def residual_columns(self, readings: dict[str, Array], q: Array, v: Array, a: Array) -> Array:
        """Minus the derivative along ``k`` changes of the joint's motion, each ``(n, k)``: ``(n, 6, k)``."""
        parts = ((self.by_q(readings), q), (self.by_v, v), (self.by_a, a))
        return -np.sum([by[:, :, None] * change[:, None, :] for by, change in parts], axis=0)


def joint_turn(state: State, joint: int) -> JointTurn:
    """Derivatives for one joint (index in the tree); those of a state are computed once."""
    kept: JointTurn = state.turn_cache.setdefault(joint, JointTurn(state, joint))
    return kept


def subtree_joints(parents: NDArray[np.int64], joint: int) -> list[int]:
    """A joint and all beyond it, by index in the tree."""
    carried = [joint]
    for index in range(joint + 1, len(parents)):
        if parents[index] in carried:
            carried.append(index)
    return carried


# A robot whose contacts nobody measures: its base's wrench as joint torques tell it, contact forces taken
# out.

# Speed about standstill within which dry friction changes sign [rad/s].
_STANDSTILL = 0.05
# What a drive's terms are expected to take together, in units of its torque's spread.
_TORQUES_SHARE = 0.3
# Singular values below this share of the largest count as zero: a leg that is stretched tells no force along it.
_STRETCHED = 1e-3


@dataclass(frozen=True, eq=False)
class TorqueState(State):
    """Motion and joint torques as a hypothesis says they truly were; forces at the feet may be anything at any time.

    With ``[0; τ] = M a + h − Aᵣ f`` of base and joints, the rows ``N = [1, X]`` with ``Aᵣ_b + Xᵀ Aᵣ_j = 0`` hold no
    contact force: each leg's torques tell its foot's force, and what is left at the base must be none. Rows of joints
    that carry no foot stand for themselves. ``N`` spans the null space of the contacts (Mistry, Buchli and Schaal
    2010) and, unlike an orthonormal basis of it, follows the posture smoothly. What hangs in a harness has the rows of
    its joints alone.

    Attributes:
        drives: ``(n_terms, n_joints)`` parameters of each drive's terms, as :func:`drive_shapes` has them.
    """

    drives: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @classmethod
    def from_log(cls, record: FloatingRecord, phi: Array | None = None) -> TorqueState:
        """The state in which the log and the nominal model are right."""
        plain = super().from_log(record, phi)
        return plain.replace(drives=np.zeros((len(drive_shapes(plain)), record.robot.n_joints)))

    @cached_property
    def contact_maps(self) -> Array:
        """``(n, nv, k)`` generalised forces per unit of each force or moment that a foot can transmit."""
        return tree_contact_maps(self.tree, self.poses, self.record.robot.feet)

    @property
    def footless_joints(self) -> NDArray[np.int64]:
        """Joints that carry no foot."""
        return np.flatnonzero(~(self.contact_maps[:, 6:] != 0.0).any(axis=(0, 2)))

    @property
    def n_base(self) -> int:
        """Number of rows of the base: none where something else than its feet holds it."""
        return 6 if self.record.robot.feet else 0

    @cached_property
    def reading_levers(self) -> dict[str, Array]:
        """``(n, n_base + n_free, n_joints)``: the joints' torques in each row."""
        n, free = self.n_base, self.footless_joints
        rows = np.zeros((len(self.q), n + len(free), self.contact_maps.shape[1] - 6))
        if n:
            rows[:, :n] = carried_wrench(self.contact_maps, _STRETCHED)
        rows[:, n + np.arange(len(free)), free] = 1.0
        return {TORQUE: rows}

    def at_base(self, force: Array, point: Array) -> Array:
        """As of any state, zero in the rows of joints."""
        wrench = super().at_base(force, point)[:, : self.n_base]
        return np.concatenate(
            [wrench, np.zeros((len(wrench), len(self.footless_joints), *wrench.shape[2:]))], axis=1
        )

    def _in_rows(self, forces: Array) -> Array:
        """Rows ``(n, c, …)`` of generalised forces ``(n, nv, …)``."""
        flat = forces.reshape(*forces.shape[:2], -1)
        rows = self.reading_levers[TORQUE] @ flat[:, 6:]
        rows[:, : self.n_base] += flat[:, : self.n_base]
        return rows.reshape(*rows.shape[:2], *forces.shape[2:])

    @cached_property
    def predicted_forces(self) -> Array:
        """``(n, c)`` what the motion needs, drives' friction in it."""
        forces = inverse_dynamics(self.tree, self.q, self.v, self.a, self.phi)
        forces[:, 6:] += np.einsum("knj,kj->nj", [*self.drive_term_shapes.values()], self.drives)
        return self._in_rows(forces)

    @cached_property
    def regressor(self) -> Array:
        """``(n, c, 10·n_segments)``."""
        return self._in_rows(joint_torque_regressor(self.tree, self.q, self.v, self.a))

    @cached_property
    def drive_term_shapes(self) -> dict[str, Array]:
        """Those of the drives' terms."""
        return drive_shapes(self)

    @cached_property
    def joint_torques(self) -> Array:
        """``(n, nv)`` torque that each joint carries, as read."""
        return np.hstack([np.zeros((len(self.q), 6)), self.readings[TORQUE]])

    @property
    def channel_units(self) -> dict[str, str]:
        """The base's wrench, then joints that carry no foot."""
        base = super().channel_units if self.n_base else {}
        return base | {self.record.robot.joint_names[j]: "N·m" for j in self.footless_joints}

    @cached_property
    def white_noise(self) -> Array:
        """``(c, c)`` covariance of the rows' white noise, that of the joints in them."""
        lever = self.reading_levers[TORQUE]
        return np.einsum("nij,jk,nlk->il", lever, self.record.sensor_noise, lever, optimize=True) / len(lever)

    @property
    def n_drive_terms(self) -> int:
        """Number of the drives' own parameters."""
        return self.drives.size

    def with_errors(self, delta: Array) -> TorqueState:
        """The state with errors of the inertial parameters, then of the drives."""
        n = len(self.record.tree.phi)
        return self.replace(phi=self.record.tree.phi + delta[:n], drives=delta[n:].reshape(self.drives.shape))

    def free_errors(self) -> FreeParameters:
        """Inertial parameters and terms of drives that are identified."""
        free, n = inertial_errors(self), len(self.record.tree.phi)
        lever, joints = self.reading_levers[TORQUE], self.record.robot.n_joints
        spread = np.maximum(self.readings[TORQUE].std(axis=0), 1e-6)
        for k, (term, shape) in enumerate(self.drive_term_shapes.items()):
            if term not in self.record.modelled:
                continue
            columns = lever * shape[:, None, :]
            size = np.maximum(np.sqrt((shape**2).mean(axis=0)), 1e-6)
            free = free.join_with(
                FreeParameters(columns, _TORQUES_SHARE * spread / size, n + joints * k + np.arange(joints))
            )
        return free


def drive_shapes(state: State) -> dict[str, Array]:
    """Torque ``(n, n_joints)`` per unit of each term of a drive, by the effect's name."""
    v, a = state.v[:, 6:], state.a[:, 6:]
    return {
        ViscousFriction.name: v,
        CoulombFriction.name: smooth_sign(v, _STANDSTILL),
        Armature.name: a,
        TorqueBias.name: np.ones_like(v),
    }


def check_legs(state: TorqueState) -> None:
    """LogError where legs have fewer joints than their feet transmit forces."""
    if not state.n_base:
        return
    left = state.contact_maps[:, :6] + state.reading_levers[TORQUE][:, :6] @ state.contact_maps[:, 6:]
    if np.median(np.abs(left).max(axis=(1, 2))) > _STRETCHED * np.abs(state.contact_maps[:, :6]).max():
        raise LogError(
            "does not tell the feet's forces: a leg has fewer joints with a torque than its foot has forces",
            field="sensors",
            remedy="log the contact wrenches, or use excite identify",
        )
