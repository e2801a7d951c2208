"""Mechanisms: a tree that loops and couplings close, and the equations of the motors that are left.

With ``K(q)`` the Jacobian of the closures, velocities are ``v = G v_m`` of those of the motors, and forces in the
cuts do no work, ``Gᵀ Kᵀ = 0``: the motors' torques are ``Gᵀ`` times the tree's generalised forces, ``τ_m = Gᵀ Y φ``
(Nakamura and Ghodoussi 1989; for identification Khalil and Dombre 2002, section 10.6).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array, Moved
from excite.errors import MotionError
from excite.robot.mechanisms.closing import ClosedTree
from excite.robot.mechanisms.closures import SINGULAR

# A random configuration out of reach is tried again at this share of its way from rest.
_PULLED = 0.6


@dataclass(frozen=True, eq=False)
class Mechanism(ClosedTree):
    """A tree that is closed, and how velocities, accelerations and forces go through it to its motors."""

    def completed(self, q: Array, v: Array, a: Array) -> Moved:
        """Configurations, velocities and accelerations of which the passive ones follow from the others.

        Args:
            q: ``(n, nq)``.
            v: ``(n, nv)``.
            a: ``(n, nv)``.

        Raises:
            MotionError: a loop cannot be closed, or its joints do not follow from the motors.
        """
        data, still, driven = self.model.createData(), np.zeros(self.model.nv), self.driven
        q, v, a = (np.array(values, dtype=float) for values in (q, v, a))
        if self.ratios is not None:
            v[:, self.passive] = v[:, driven] @ self.ratios.velocities.T
            a[:, self.passive] = a[:, driven] @ self.ratios.velocities.T
            return Moved(self.ratios.closed(q), v, a)
        columns, before = self._coordinates, self.rest
        for i in range(len(q)):
            before = q[i] = self._reached(data, before, q[i], columns, i)
            # Closing has left the joints' Jacobians in the data.
            jacobian = self._jacobian(q[i], data)
            inverse = self._inverse(jacobian, i)
            v[i, self.passive] = -inverse @ (jacobian[:, driven] @ v[i, driven])
            pin.forwardKinematics(self.model, data, q[i], v[i], still)
            a[i, self.passive] = -inverse @ (
                jacobian[:, driven] @ a[i, driven] + self._drift(q[i], v[i], data)
            )
        return Moved(q, v, a)

    def velocities(self, q: Array, v: Array) -> Array:
        """Velocities ``(n, nv)`` of which the passive ones follow from the others, at closed ``q`` ``(n, nq)``."""
        return np.asarray(np.einsum("nij,nj->ni", self.motion_maps(q), v[:, self.driven]))

    def accelerations(self, q: Array, v: Array, a: Array) -> Array:
        """Accelerations ``(n, nv)`` of which the passive ones follow from the others, ``v`` from :meth:`velocities`."""
        data, still = self.model.createData(), np.zeros(self.model.nv)
        out, driven = np.array(a, dtype=float), self.driven
        if self.ratios is not None:
            out[:, self.passive] = out[:, driven] @ self.ratios.velocities.T
            return out
        for i in range(len(q)):
            pin.forwardKinematics(self.model, data, q[i], v[i], still)
            drift = self._drift(q[i], v[i], data)
            pin.computeJointJacobians(self.model, data, q[i])
            jacobian = self._jacobian(q[i], data)
            out[i, self.passive] = -self._inverse(jacobian, i) @ (jacobian[:, driven] @ a[i, driven] + drift)
        return out

    def motion_maps(self, q: Array) -> Array:
        """``G``: velocities per velocity of what is driven, ``(n, nv, n_driven)``.

        Args:
            q: ``(n, nq)`` configurations.

        Raises:
            MotionError: the passive joints do not follow from the others: too few loops, or a singular position.
        """
        data, driven = self.model.createData(), self.driven
        maps = np.zeros((len(q), self.model.nv, len(driven)))
        maps[:, driven, np.arange(len(driven))] = 1.0
        if self.ratios is not None:
            maps[:, self.passive] = self.ratios.velocities
            return maps
        for i in range(len(q)):
            pin.computeJointJacobians(self.model, data, q[i])
            jacobian = self._jacobian(q[i], data)
            maps[i, self.passive] = -self._inverse(jacobian, i) @ jacobian[:, driven]
        return maps

    def on_motors(self, q: Array, forces: Array) -> Array:
        """The tree's generalised forces as the motors (and a free base) have to exert them.

        Args:
            q: ``(n, nq)`` closed configurations.
            forces: ``(n, nv)`` or ``(n, nv, k)``, such as a regressor.

        Returns:
            The same shape; zero for passive joints.

        Raises:
            MotionError: as :meth:`motion_maps`.
        """
        out = np.zeros_like(forces)
        out[:, self.driven] = np.einsum("nij,ni...->nj...", self.motion_maps(q), forces)
        return out

    def drawn(self, rng: np.random.Generator, lower: Array, upper: Array, n: int) -> Array:
        """Closed configurations ``(n, nq)`` whose driven joints are drawn between bounds ``(n_joints,)``.

        A draw out of reach is pulled towards rest until it is within. A free base stays at rest.
        """
        data, columns = self.model.createData(), self._coordinates
        first = self.model.nq - len(lower)
        out = np.empty((n, self.model.nq))
        for i in range(n):
            way, share = np.zeros(self.model.nq), 1.0
            way[first:] = rng.uniform(lower, upper) - self.rest[first:]
            while True:
                try:
                    out[i] = self._reached(data, self.rest, self.rest + share * way, columns, i)
                    self.motion_maps(out[i : i + 1])
                    break
                except MotionError:
                    share *= _PULLED
        return out

    def following_from(self, given: NDArray[np.int64]) -> Mechanism:
        """The same with other joints moved to close it: none of ``given`` (indices into ``v``) if that can be.

        Passive joints among ``given`` are exchanged for driven ones that the same closures move.
        """
        wanted = np.intersect1d(self.passive, given)
        if not len(wanted):
            return self
        data = self.model.createData()
        pin.computeJointJacobians(self.model, data, self.rest)
        jacobian = self._jacobian(self.rest, data)
        moved = np.flatnonzero(np.abs(jacobian).max(axis=0) > SINGULAR * np.abs(jacobian).max())
        base = np.arange(6 if self._free else 0)
        passive = np.setdiff1d(self.passive, given)
        for column in np.setdiff1d(moved, np.concatenate([given, base, passive])):
            if len(passive) == len(self.passive):
                break
            more = np.sort(np.append(passive, column))
            if np.linalg.matrix_rank(jacobian[:, more], tol=SINGULAR * np.abs(jacobian).max()) == len(more):
                passive = more
        return replace(self, passive=passive) if len(passive) == len(self.passive) else self

    def _inverse(self, jacobian: Array, sample: int) -> Array:
        """Pseudo-inverse of the passive joints' part, ``(n_passive, n_equations)``, once it determines them all."""
        own = jacobian[:, self.passive]
        u, s, vt = np.linalg.svd(own, full_matrices=False)
        rank = int((s > SINGULAR * max(float(s.max(initial=0.0)), 1e-300)).sum())
        if rank < len(self.passive):
            loose = int(np.argmax(np.abs(np.linalg.svd(own)[2][-1])))
            where = list(self.model.idx_vs).index(int(self.passive[loose]), 1)
            raise MotionError(
                f"does not follow from the motors at sample {sample}: {len(self.passive)} passive joints, and the"
                f" loops determine {rank}",
                field=f"joint {self.model.names[where]!r}",
                remedy="state the loop that is missing, or keep away from its singular position",
            )
        return np.asarray((vt.T / s) @ u.T)
