"""What models leave of the trials that judge, and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.design import Design
from excite.diagnosis.budget.joint_fit import Model, fit


@dataclass(frozen=True, eq=False)
class Power:
    """Mean squares on the trials that judge.

    Attributes:
        mean: ``(n_joints,)``.
        blocks: ``(n_judged, n_joints)`` without a block each of those that judge.
        fits: ``(n_blocks, n_joints)`` of fits without a block each.
    """

    mean: Array
    blocks: Array
    fits: Array

    def combined(self, other: Power, sign: float) -> Power:
        """Sum with a multiple of another."""
        return Power(
            self.mean + sign * other.mean, self.blocks + sign * other.blocks, self.fits + sign * other.fits
        )


def power_of(model: Model) -> Power:
    """Mean squares that a fitted model leaves."""
    grams = model.design.judged
    left = model.power(grams) * grams.count[:, None]
    total, count = left.sum(axis=0), float(grams.count.sum())
    without = (total - left) / np.maximum(count - grams.count, 1.0)[:, None]
    fits = np.empty((len(model.left_out), len(grams.total)))
    for j, (g, c, p) in enumerate(zip(grams.total, model.layout.columns, model.layout.numbers, strict=True)):
        z = model.left_out[:, p]
        inner = z @ g[np.ix_(c, c)] - 2.0 * g[c, -1]
        fits[:, j] = (g[-1, -1] + (inner * z).sum(axis=1)) / count
    return Power(total / count, without, fits)


def judged_power(design: Design, chosen: Sequence[int], weight: Array | None = None) -> Power:
    """What the terms leave when they are fitted together."""
    return power_of(fit(design, chosen, weight))


def deviation(values: Array) -> Array:
    """Standard deviation of a jackknife ``(n, …)`` (Miller 1974)."""
    n = len(values)
    if n < 2:
        return np.zeros(values.shape[1:])
    return np.sqrt((n - 1) / n * ((values - values.mean(axis=0)) ** 2).sum(axis=0))
