"""Evidence for a hypothesis: a likelihood ratio over effective samples, and the power it takes away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array

_LAGS = 200


@dataclass(frozen=True, eq=False)
class Power:
    """Mean squares of residuals by joint.

    Attributes:
        identification: ``(n_joints,)`` [(N·m)²].
        validation: ``(n_joints,)``; the identification trials' where there are no others.
    """

    identification: Array
    validation: Array


@dataclass(frozen=True, eq=False)
class Judge:
    """Compares fits of the same rows.

    Attributes:
        use: identification rows.
        count: ``(n_joints, 2)`` effective samples in identification and validation rows.
        floor: ``(n_joints,)`` noise in the band [N·m].
    """

    use: NDArray[np.bool_]
    count: Array
    floor: Array

    def power(self, residual: Array) -> Power:
        """Mean squares of residuals ``(n_joints, n_rows)``."""
        squares = residual**2
        inside = squares[:, self.use].mean(axis=1)
        outside = squares[:, ~self.use].mean(axis=1) if (~self.use).any() else inside
        return Power(inside, outside)

    def ratio(self, before: Array, after: Array) -> Array:
        """Log-likelihood ratio by joint ``(n_joints, 2)`` [nats] from residuals: identification, validation."""
        least = self.floor**2
        p, r = self.power(before), self.power(after)
        logs = np.column_stack(
            [
                np.log(np.maximum(p.identification, least) / np.maximum(r.identification, least)),
                np.log(p.validation / r.validation),
            ]
        )
        return 0.5 * self.count * logs


def effective_counts(residual: Array, use: NDArray[np.bool_], trial: NDArray[np.int64]) -> Array:
    """Effective samples of each joint's residual, ``(n_joints, 2)``: n / (1 + 2 Σ ρ_k) by initial positive sums.

    (Geyer 1992, section 3.3: pairs of neighbouring autocorrelations are added while their sum is positive.)
    """
    counts = np.zeros((len(residual), 2))
    for side, rows in enumerate((use, ~use)):
        if not rows.any():
            continue
        totals = np.zeros((len(residual), _LAGS))
        for k in np.unique(trial[rows]):
            r = np.ascontiguousarray(residual[:, trial == k])
            r = r - r.mean(axis=1, keepdims=True)
            f = np.fft.rfft(r, 2 * r.shape[1], axis=1)
            acf = np.fft.irfft(np.abs(f) ** 2, axis=1)[:, :_LAGS]
            totals[:, : acf.shape[1]] += acf
        for j, total in enumerate(totals):
            rho = total / max(total[0], 1e-300)
            pairs = rho[0:-1:2] + rho[1::2]
            stop = np.flatnonzero(pairs <= 0.0)
            pairs = pairs[: stop[0]] if len(stop) else pairs
            tau = max(1.0, 2.0 * pairs.sum() - 1.0)
            # Rows that hold no known torque leave nothing.
            counts[j, side] = np.count_nonzero(residual[j, rows]) / tau
    return counts
