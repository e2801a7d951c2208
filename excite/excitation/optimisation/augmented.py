"""Nonlinear limits by an augmented Lagrangian, so that the program itself keeps only linear rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array

ValueAndGradient = Callable[[Array], tuple[float, Array]]
RowsAndJacobian = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class AugmentedLagrangian:
    """``f(x) + (μ/2) Σ (max(0, λ/μ − g(x))² − (λ/μ)²)`` for rows ``g(x) ≥ 0`` (Nocedal and Wright 2006, 17.4).

    A random start violates rows by much, which leaves a sequence of quadratic programs without a feasible one;
    a penalty pulls it in, and multipliers make the penalty's bias vanish.

    Attributes:
        objective: ``f`` and its gradient.
        rows: ``g`` and its Jacobian, None where there are none.
        multipliers: ``λ``, one a row.
        weight: ``μ``.
    """

    objective: ValueAndGradient
    rows: RowsAndJacobian | None
    multipliers: Array
    weight: float

    def __call__(self, x: Array) -> tuple[float, Array]:
        """Value and gradient."""
        value, gradient = self.objective(x)
        if self.rows is None:
            return value, gradient
        left, jacobian = self.rows(x)
        lack = np.maximum(0.0, self.multipliers / self.weight - left)
        value += 0.5 * self.weight * float((lack**2).sum() - ((self.multipliers / self.weight) ** 2).sum())
        return value, gradient - self.weight * (lack @ jacobian)

    def updated(self, x: Array) -> Array:
        """Multipliers for the next solve, from where this one ended."""
        if self.rows is None:
            return self.multipliers
        return np.maximum(0.0, self.multipliers - self.weight * self.rows(x)[0])
