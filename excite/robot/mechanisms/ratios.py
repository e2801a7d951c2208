"""Couplings of constant ratios, such as a hand's fingers have: all samples at once, without Newton's method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.robot.mechanisms.closures import SINGULAR, Closure, Coupling


@dataclass(frozen=True, eq=False)
class ConstantRatios:
    """Closures that are all sums of joints times constants, as many as joints that follow from them.

    Attributes:
        sums: ``(n_passive, nq)`` factors of all positions in each closure.
        offset: ``(n_passive,)`` what each adds up to [rad or m].
        columns: indices into ``q`` of the joints that follow.
        velocities: ``(n_passive, n_driven)`` velocities of these per velocity of what is driven.
    """

    sums: Array
    offset: Array
    columns: list[int]
    velocities: Array

    @classmethod
    def of(
        cls,
        model: pin.Model,
        closures: Sequence[Closure],
        passive: NDArray[np.int64],
        driven: NDArray[np.int64],
    ) -> ConstantRatios | None:
        """The ratios of a tree's closures; None where one is no such sum, or they leave a joint loose or contradict."""
        sums = [closure for closure in closures if isinstance(closure, Coupling) and closure.constant]
        if len(sums) != len(closures) or len(sums) != len(passive):
            return None
        of_q, of_v = np.zeros((len(sums), model.nq)), np.zeros((len(sums), model.nv))
        for row, coupling in enumerate(sums):
            for (position, column), factors in zip(coupling.columns, coupling.factors, strict=True):
                of_q[row, position] += factors[0]
                of_v[row, column] += factors[0]
        own = of_v[:, passive]
        sizes = np.linalg.svd(own, compute_uv=False)
        if not len(sizes) or sizes[-1] <= SINGULAR * sizes[0]:
            return None
        place = {
            int(model.idx_vs[joint]): int(model.idx_qs[joint])
            for joint in range(1, model.njoints)
            if model.nvs[joint] == model.nqs[joint] == 1
        }
        return cls(
            of_q,
            np.array([coupling.offset for coupling in sums]),
            [place[int(column)] for column in passive],
            -np.linalg.solve(own, of_v[:, driven]),
        )

    def closed(self, q: Array) -> Array:
        """Configurations ``(n, nq)`` in which these joints stand as the others want it."""
        out = np.array(q, dtype=float)
        out[:, self.columns] = 0.0
        out[:, self.columns] = np.linalg.solve(
            self.sums[:, self.columns], (self.offset - out @ self.sums.T).T
        ).T
        return out

    def gaps(self, q: Array) -> Array:
        """How far the worst closure is open, ``(n,)`` [rad or m]."""
        return np.asarray(np.abs(q @ self.sums.T - self.offset).max(axis=1))
