"""Closing a tree of joints: positions of those that no motor drives, by Newton's method on loops and couplings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import MotionError
from excite.robot.mechanisms.closures import SINGULAR, Closure
from excite.robot.mechanisms.ratios import ConstantRatios

# Gaps are closed to this [m or rad]: far below what geometry is known to, far above rounding.
_CLOSED = 1e-10
# Newton's method takes 3 to 6 steps where a mechanism is within reach, and never ends where it is not.
_STEPS = 15
# A step of Newton's method turns no joint further than this [rad], so that it stays on the branch it is on.
_LONGEST_STEP = 0.3
# Configurations further apart than this [rad or m] are joined by others in between, for the same reason.
_APART = 0.2


@dataclass(frozen=True, eq=False)
class ClosedTree:
    """A tree, the closures that it has to meet, and the velocities that no motor drives.

    Attributes:
        model: the tree; every joint of a closure has one coordinate.
        closures: its loops and couplings.
        passive: ``(n_passive,)`` indices into ``v`` of joints without a motor.
        rest: ``(nq,)`` closed configuration from which others are reached.
    """

    model: pin.Model
    closures: tuple[Closure, ...]
    passive: NDArray[np.int64]
    rest: Array

    @property
    def driven(self) -> NDArray[np.int64]:
        """Indices into ``v`` of all others: motors, and a free base."""
        return np.setdiff1d(np.arange(self.model.nv), self.passive)

    @cached_property
    def ratios(self) -> ConstantRatios | None:
        """All closures as constant ratios, which need no search; None where one is more than that."""
        return ConstantRatios.of(self.model, self.closures, self.passive, self.driven)

    @property
    def meeting(self) -> set[frozenset[int]]:
        """Pairs of model joints whose links meet where a loop closes."""
        return {frozenset(closure.meets) for closure in self.closures if closure.meets}

    def closed(self, q: Array) -> Array:
        """Configurations whose closures hold, the passive joints moved alone.

        Args:
            q: ``(n, nq)``; passive joints are found from the sample before, those of the first from rest.

        Returns:
            ``(n, nq)``.

        Raises:
            MotionError: a loop cannot be closed.
        """
        if self.ratios is not None:
            return self.ratios.closed(q)
        data, out = self.model.createData(), np.array(q, dtype=float)
        columns, before = self._coordinates, self.rest
        for i in range(len(out)):
            before = out[i] = self._reached(data, before, out[i], columns, i)
        return out

    def gaps(self, q: Array) -> Array:
        """How far the worst closure is open, ``(n,)`` [m or rad]."""
        if self.ratios is not None:
            return self.ratios.gaps(q)
        data, out = self.model.createData(), np.zeros(len(q))
        for i in range(len(q)):
            pin.forwardKinematics(self.model, data, q[i])
            out[i] = np.abs(self._gap(q[i], data)).max(initial=0.0)
        return out

    def widest(self, q: Array) -> str:
        """Name of the closure that is widest open at ``q`` ``(nq,)``."""
        data = self.model.createData()
        pin.forwardKinematics(self.model, data, q)
        return max(self.closures, key=lambda closure: float(np.abs(closure.gap(q, data)).max())).name

    @property
    def _coordinates(self) -> list[int]:
        model, passive = self.model, set(self.passive.tolist())
        return [int(model.idx_qs[j]) for j in range(1, model.njoints) if model.idx_vs[j] in passive]

    def _reached(self, data: pin.Data, start: Array, q: Array, columns: list[int], sample: int) -> Array:
        """``q`` closed, on the way of the driven joints from the closed configuration ``start``."""
        way = pin.difference(self.model, start, q)
        way[self.passive] = 0.0
        count = max(1, int(np.ceil(np.abs(way[6:] if self._free else way).max(initial=0.0) / _APART)))
        before = start
        for k in range(1, count + 1):
            here = pin.integrate(self.model, start, way * (k / count)) if k < count else q.copy()
            here[columns] = before[columns]
            before = self._closed(data, here, sample)
        return before

    @property
    def _free(self) -> bool:
        return bool(self.model.nq != self.model.nv)

    def _closed(self, data: pin.Data, q: Array, sample: int) -> Array:
        step = np.zeros(self.model.nv)
        for _ in range(_STEPS):
            pin.computeJointJacobians(self.model, data, q)
            gap = self._gap(q, data)
            if np.abs(gap).max(initial=0.0) < _CLOSED:
                return q
            move = -np.linalg.pinv(self._jacobian(q, data)[:, self.passive], rcond=SINGULAR) @ gap
            step[self.passive] = move * min(1.0, _LONGEST_STEP / max(float(np.abs(move).max()), 1e-300))
            q = pin.integrate(self.model, q, step)
        sizes = [float(np.abs(closure.gap(q, data)).max()) for closure in self.closures]
        worst = int(np.argmax(sizes))
        raise MotionError(
            f"cannot be closed at sample {sample}: {1e3 * sizes[worst]:.3g} mm or mrad stay open",
            field=f"{self.closures[worst].field}.{self.closures[worst].name}",
            remedy="check it in robot.yaml, and that positions are within reach",
        )

    def _gap(self, q: Array, data: pin.Data) -> Array:
        return np.concatenate([closure.gap(q, data) for closure in self.closures])

    def _drift(self, q: Array, v: Array, data: pin.Data) -> Array:
        return np.concatenate([closure.drift(q, v, data) for closure in self.closures])

    def _jacobian(self, q: Array, data: pin.Data) -> Array:
        return np.vstack([closure.jacobian(self.model, q, data) for closure in self.closures])
