"""A robot whose contacts nobody measures: its base's wrench as joint torques tell it, contact forces taken out."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.effects.friction import CoulombFriction, ViscousFriction
from excite.diagnosis.effects.gears.gear_effect import Armature
from excite.diagnosis.effects.readings import TorqueBias
from excite.diagnosis.floating.equations.record import TORQUE, FloatingRecord
from excite.diagnosis.floating.equations.state import Free, State, inertial_errors
from excite.errors import LogError
from excite.regressor.contact_forces import carried_wrench, tree_contact_maps
from excite.regressor.kernels import inverse_dynamics, joint_torque_regressor
from excite.rows.drive_terms import smooth_sign

# Speed about standstill within which dry friction changes sign [rad/s].
_STANDSTILL = 0.05
# What a drive's terms are expected to take together, in units of its torque's spread.
_SHARE = 0.3
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
    def logged(cls, record: FloatingRecord, phi: Array | None = None) -> TorqueState:
        """The state in which the log and the nominal model are right."""
        plain = super().logged(record, phi)
        return plain.replace(drives=np.zeros((len(drive_shapes(plain)), record.robot.n_joints)))

    @cached_property
    def contacts(self) -> Array:
        """``(n, nv, k)`` generalised forces per unit of each force or moment that a foot can transmit."""
        return tree_contact_maps(self.tree, self.poses, self.record.robot.feet)

    @property
    def free(self) -> NDArray[np.int64]:
        """Joints that carry no foot."""
        return np.flatnonzero(~(self.contacts[:, 6:] != 0.0).any(axis=(0, 2)))

    @property
    def n_base(self) -> int:
        """Number of rows of the base: none where something else than its feet holds it."""
        return 6 if self.record.robot.feet else 0

    @cached_property
    def levers(self) -> dict[str, Array]:
        """``(n, n_base + n_free, n_joints)``: the joints' torques in each row."""
        n, free = self.n_base, self.free
        rows = np.zeros((len(self.q), n + len(free), self.contacts.shape[1] - 6))
        if n:
            rows[:, :n] = carried_wrench(self.contacts, _STRETCHED)
        rows[:, n + np.arange(len(free)), free] = 1.0
        return {TORQUE: rows}

    def at_base(self, force: Array, point: Array) -> Array:
        """As of any state, zero in the rows of joints."""
        wrench = super().at_base(force, point)[:, : self.n_base]
        return np.concatenate([wrench, np.zeros((len(wrench), len(self.free), *wrench.shape[2:]))], axis=1)

    def _in_rows(self, forces: Array) -> Array:
        """Rows ``(n, c, …)`` of generalised forces ``(n, nv, …)``."""
        flat = forces.reshape(*forces.shape[:2], -1)
        rows = self.levers[TORQUE] @ flat[:, 6:]
        rows[:, : self.n_base] += flat[:, : self.n_base]
        return rows.reshape(*rows.shape[:2], *forces.shape[2:])

    @cached_property
    def predicted(self) -> Array:
        """``(n, c)`` what the motion needs, drives' friction in it."""
        forces = inverse_dynamics(self.tree, self.q, self.v, self.a, self.phi)
        forces[:, 6:] += np.einsum("knj,kj->nj", [*self.shapes.values()], self.drives)
        return self._in_rows(forces)

    @cached_property
    def regressor(self) -> Array:
        """``(n, c, 10·n_segments)``."""
        return self._in_rows(joint_torque_regressor(self.tree, self.q, self.v, self.a))

    @cached_property
    def shapes(self) -> dict[str, Array]:
        """Those of the drives' terms."""
        return drive_shapes(self)

    @cached_property
    def joint_torques(self) -> Array:
        """``(n, nv)`` torque that each joint carries, as read."""
        return np.hstack([np.zeros((len(self.q), 6)), self.readings[TORQUE]])

    @property
    def channels(self) -> dict[str, str]:
        """The base's wrench, then joints that carry no foot."""
        base = super().channels if self.n_base else {}
        return base | {self.record.robot.joint_names[j]: "N·m" for j in self.free}

    @cached_property
    def white_noise(self) -> Array:
        """``(c, c)`` covariance of the rows' white noise, that of the joints in them."""
        lever = self.levers[TORQUE]
        return np.einsum("nij,jk,nlk->il", lever, self.record.sensor_noise, lever, optimize=True) / len(lever)

    @property
    def n_drive_terms(self) -> int:
        """Number of the drives' own parameters."""
        return self.drives.size

    def with_errors(self, delta: Array) -> TorqueState:
        """The state with errors of the inertial parameters, then of the drives."""
        n = len(self.record.tree.phi)
        return self.replace(phi=self.record.tree.phi + delta[:n], drives=delta[n:].reshape(self.drives.shape))

    def free_errors(self) -> Free:
        """Inertial parameters and terms of drives that are identified."""
        free, n = inertial_errors(self), len(self.record.tree.phi)
        lever, joints = self.levers[TORQUE], self.record.robot.n_joints
        spread = np.maximum(self.readings[TORQUE].std(axis=0), 1e-6)
        for k, (term, shape) in enumerate(self.shapes.items()):
            if term not in self.record.modelled:
                continue
            columns = lever * shape[:, None, :]
            size = np.maximum(np.sqrt((shape**2).mean(axis=0)), 1e-6)
            free = free.beside(Free(columns, _SHARE * spread / size, n + joints * k + np.arange(joints)))
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
    left = state.contacts[:, :6] + state.levers[TORQUE][:, :6] @ state.contacts[:, 6:]
    if np.median(np.abs(left).max(axis=(1, 2))) > _STRETCHED * np.abs(state.contacts[:, :6]).max():
        raise LogError(
            "does not tell the feet's forces: a leg has fewer joints with a torque than its foot has forces",
            field="sensors",
            remedy="log the contact wrenches, or use excite identify",
        )
