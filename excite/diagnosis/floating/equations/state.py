"""What a hypothesis makes of a record: the base wrench that is then measured less the one predicted."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.diagnosis.floating.equations.cross import cross
from excite.diagnosis.floating.equations.record import FloatingRecord
from excite.logs.signals.butterworth import lowpass
from excite.regressor.kernels import Placements, base_link_regressor, forward_kinematics, inverse_dynamics
from excite.regressor.tree import KinematicTree

_MOTION = {"tree", "q"}
_DEPENDS: dict[str, set[str]] = {
    "poses": _MOTION,
    "levers": _MOTION | {"placements"},
    "measured": _MOTION | {"readings", "placements"},
    "measured_phi": {"phi"},
    "predicted": _MOTION | {"v", "a", "phi"},
    "regressor": _MOTION | {"v", "a"},
    "smooth_torques": _MOTION | {"v", "a", "phi", "readings", "placements"},
    "joint_torques": _MOTION | {"v", "a", "phi", "readings", "placements"},
    "turns": _MOTION | {"v", "a", "phi", "placements"},
    "carried": _MOTION | {"v", "a"},
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
    def logged(cls, record: FloatingRecord, phi: Array | None = None) -> State:
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

    def replace(self, **changes: Any) -> State:
        """A copy with fields replaced; what was computed and does not depend on them is kept."""
        other, changed = dataclasses.replace(self, **changes), set(changes)
        # The base's equation holds nothing of segments beyond the sensors.
        if "phi" in changed and np.array_equal(other.measured_phi, self.measured_phi):
            changed.remove("phi")
        # Whoever finds a joint's turn or a segment's load first, all states of the same motion have it.
        self.__dict__.setdefault("turns", {})
        self.__dict__.setdefault("carried", {})
        for name, depends in _DEPENDS.items():
            if name in self.__dict__ and not depends & changed:
                other.__dict__[name] = self.__dict__[name]
        return other

    @cached_property
    def poses(self) -> Placements:
        """World poses of all joints."""
        return forward_kinematics(self.tree, self.q)

    @cached_property
    def measured(self) -> Array:
        """``(n, 6)`` sum of the contact wrenches at the base's origin, base frame (Jovic et al. 2015, eq. 2)."""
        total = np.zeros((len(self.q), 6))
        for name, lever in self.levers.items():
            total += np.einsum("nij,nj->ni", lever, self.readings[name])
        return total

    @cached_property
    def levers(self) -> dict[str, Array]:
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
        turned = np.concatenate([force, cross(point - self.poses.translation[:, 1], force)], axis=1)
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
    def predicted(self) -> Array:
        """``(n, 6)`` wrench that the motion needs, base frame."""
        return inverse_dynamics(self.tree, self.q, self.v, self.a, self.measured_phi)[:, :6]

    @property
    def residual(self) -> Array:
        """``(n, 6)`` measured plus further wrenches less predicted [N, N·m]."""
        return self.measured + self.extra - self.predicted

    @cached_property
    def regressor(self) -> Array:
        """``(n, 6, 10·n_segments)`` of the wrench, columns of unmeasured segments zero."""
        body = base_link_regressor(self.tree, self.q, self.v, self.a)
        for segment in self.record.unmeasured:
            body[:, :, 10 * segment : 10 * segment + 10] = 0.0
        return body

    @cached_property
    def turns(self) -> dict[int, Any]:
        """By joint, the derivatives that ``joint_turn`` has found for this motion; a store that it alone reads."""
        return {}

    @cached_property
    def carried(self) -> dict[int, Array]:
        """By segment, what :meth:`on_unit_mass` has found for this motion."""
        return {}

    def on_unit_mass(self, segment: int, place: Array) -> Array:
        """``(n, 3)`` force on a unit mass that moves with a segment: acceleration less gravity, world [m/s²].

        Args:
            segment: its index.
            place: ``(3,)`` of the mass, in the frame of the segment's joint [m].
        """
        if segment not in self.carried:
            forces = [self._on_unit_mass(segment, corner) for corner in (np.zeros(3), *np.eye(3))]
            self.carried[segment] = np.stack([forces[0], *(f - forces[0] for f in forces[1:])], axis=2)
        # Accelerations of points of a body are affine in their place.
        return np.asarray(self.carried[segment] @ np.concatenate([[1.0], place]))

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
                arm = cross(point - self.poses.translation[:, joint], force) + moment
                torque[:, self.tree.idx_v[joint]] -= np.einsum("ni,ni->n", axis, arm)
                joint = int(self.tree.parents[joint])
        return torque

    @cached_property
    def smooth_torques(self) -> Array:
        """The same without what is above 4 Hz, where they hold noise of accelerations."""
        return self._smooth(self.joint_torques)

    def smooth_torque(self, iv: int) -> Array:
        """``(n,)`` the same of one joint, by its index in the velocities, where no other is asked for."""
        return self._smooth(self.joint_torques[:, iv])

    def _smooth(self, values: Array) -> Array:
        return np.concatenate([lowpass(values[s], self.record.rate_hz, 4.0) for s in self.record.spans])
