"""Mechanisms with closed loops: what the motors move, and the motors' equations of a tree that was cut open.

With ``K(q)`` the Jacobian of the loops' closure, velocities are ``v = G v_m`` of those of the motors, and forces in the
cuts do no work, ``Gᵀ Kᵀ = 0``: the motors' torques are ``Gᵀ`` times the tree's generalised forces, ``τ_m = Gᵀ Y φ``
(Nakamura and Ghodoussi 1989; for identification Khalil and Dombre 2002, section 10.6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import MotionError
from excite.robot.loops import Loop

# Singular values of the passive joints' part of K below this share of the largest are rounding: equations that say
# the same, as a plane's do. A mechanism that is so near a singular position amplifies any error a million times.
_SINGULAR = 1e-6
# Gaps are closed to this [m or rad]: far below what geometry is known to, far above rounding.
_CLOSED = 1e-10
_STEPS = 50
# A step of Newton's method turns no joint further than this [rad], so that it stays on the branch it is on.
_LONGEST_STEP = 0.3


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A tree, the loops that close it, and the velocities that no motor drives.

    Attributes:
        model: the tree; every joint of a loop has one coordinate.
        loops: its loops.
        passive: ``(n_passive,)`` indices into ``v`` of what follows from the rest.
    """

    model: pin.Model
    loops: tuple[Loop, ...]
    passive: NDArray[np.int64]

    @property
    def driven(self) -> NDArray[np.int64]:
        """Indices into ``v`` of all others: motors, and a free base."""
        return np.setdiff1d(np.arange(self.model.nv), self.passive)

    def closed(self, q: Array) -> Array:
        """Configurations whose loops are closed, the passive joints moved alone.

        Args:
            q: ``(n, nq)``; passive joints of the first sample are a guess, of others the sample before is one.

        Returns:
            ``(n, nq)``.

        Raises:
            MotionError: a loop cannot be closed.
        """
        data, out = self.model.createData(), np.array(q, dtype=float)
        columns = self._coordinates
        for i in range(len(out)):
            if i:
                out[i, columns] = out[i - 1, columns]
            out[i] = self._closed(data, out[i], i)
        return out

    def velocities(self, q: Array, v: Array) -> Array:
        """Velocities ``(n, nv)`` of which the passive ones follow from the others, at closed ``q`` ``(n, nq)``."""
        return np.asarray(np.einsum("nij,nj->ni", self.motion_maps(q), v[:, self.driven]))

    def accelerations(self, q: Array, v: Array, a: Array) -> Array:
        """Accelerations ``(n, nv)`` of which the passive ones follow from the others, ``v`` from :meth:`velocities`."""
        data, still = self.model.createData(), np.zeros(self.model.nv)
        out = np.array(a, dtype=float)
        for i in range(len(q)):
            pin.forwardKinematics(self.model, data, q[i], v[i], still)
            drift = np.concatenate([loop.drift(data) for loop in self.loops])
            pin.computeJointJacobians(self.model, data, q[i])
            jacobian = self._jacobian(data)
            inverse = self._inverse(jacobian, i)
            out[i, self.passive] = -inverse @ (jacobian[:, self.driven] @ a[i, self.driven] + drift)
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
        for i in range(len(q)):
            pin.computeJointJacobians(self.model, data, q[i])
            jacobian = self._jacobian(data)
            maps[i, self.passive] = -self._inverse(jacobian, i) @ jacobian[:, driven]
        return maps

    def gaps(self, q: Array) -> Array:
        """How far the loops are open, ``(n,)`` [m or rad]."""
        data, out = self.model.createData(), np.zeros(len(q))
        for i in range(len(q)):
            pin.forwardKinematics(self.model, data, q[i])
            out[i] = np.abs(self._gap(data)).max(initial=0.0)
        return out

    @property
    def _coordinates(self) -> list[int]:
        model = self.model
        joints = [j for j in range(1, model.njoints) if model.idx_vs[j] in set(self.passive.tolist())]
        return [int(model.idx_qs[j]) for j in joints]

    def _closed(self, data: pin.Data, q: Array, sample: int) -> Array:
        step = np.zeros(self.model.nv)
        for _ in range(_STEPS):
            pin.computeJointJacobians(self.model, data, q)
            gap = self._gap(data)
            if np.abs(gap).max(initial=0.0) < _CLOSED:
                return q
            move = -np.linalg.pinv(self._jacobian(data)[:, self.passive], rcond=_SINGULAR) @ gap
            step[self.passive] = move * min(1.0, _LONGEST_STEP / max(float(np.abs(move).max()), 1e-300))
            q = pin.integrate(self.model, q, step)
        sizes = [float(np.abs(loop.gap(data)).max()) for loop in self.loops]
        worst = int(np.argmax(sizes))
        raise MotionError(
            f"cannot be closed at sample {sample}: {1e3 * sizes[worst]:.3g} mm or mrad stay open",
            field=f"loops.{self.loops[worst].name}",
            remedy="check the loop's ends in robot.yaml, and that positions are within reach",
        )

    def _gap(self, data: pin.Data) -> Array:
        return np.concatenate([loop.gap(data) for loop in self.loops])

    def _jacobian(self, data: pin.Data) -> Array:
        return np.vstack([loop.jacobian(self.model, data) for loop in self.loops])

    def _inverse(self, jacobian: Array, sample: int) -> Array:
        """Pseudo-inverse of the passive joints' part, ``(n_passive, n_equations)``, once it determines them all."""
        own = jacobian[:, self.passive]
        u, s, vt = np.linalg.svd(own, full_matrices=False)
        rank = int((s > _SINGULAR * max(float(s.max(initial=0.0)), 1e-300)).sum())
        if rank < len(self.passive):
            names = [self.model.names[j] for j in range(1, self.model.njoints)]
            loose = int(np.argmax(np.abs(np.linalg.svd(own)[2][-1])))
            name = names[
                [self.model.idx_vs[j + 1] for j in range(len(names))].index(int(self.passive[loose]))
            ]
            raise MotionError(
                f"does not follow from the motors at sample {sample}: {len(self.passive)} passive joints, and the"
                f" loops determine {rank}",
                field=f"joint {name!r}",
                remedy="state the loop that is missing, or keep away from its singular position",
            )
        return np.asarray((vt.T / s) @ u.T)


def mechanism(model: pin.Model, loops: Sequence[Loop], passive: Sequence[str]) -> Mechanism:
    """A mechanism by the names of its passive joints, each of one coordinate."""
    columns = [int(model.idx_vs[model.getJointId(name)]) for name in passive]
    return Mechanism(model, tuple(loops), np.array(sorted(columns), dtype=np.int64))
