"""Linear constraints on parameters, with names for every row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array


@dataclass(frozen=True, eq=False)
class LinearConstraints:
    """``matrix · θ ≥ bound``; the first ``n_equal`` rows hold with equality.

    Rows are scaled so that a row's value is in the unit of a mass [kg] per unit of its ``scale``: a
    violation of one is as serious as a kilogram that is missing.

    Attributes:
        matrix: ``(n_rows, n_params)``.
        bound: ``(n_rows,)``.
        labels: what each row says, ``kind:segment``.
        n_equal: number of leading rows that are equalities.
    """

    matrix: Array
    bound: Array
    labels: tuple[str, ...]
    n_equal: int = 0

    def violations(self, parameters: Array) -> Array:
        """How far each row is violated, ``(n_rows,)``, zero where it holds."""
        slack = self.matrix @ parameters - self.bound
        violation = np.maximum(-slack, 0.0)
        violation[: self.n_equal] = np.abs(slack[: self.n_equal])
        return violation

    def only(self, mask: NDArray[np.bool_]) -> LinearConstraints:
        """The rows of a mask ``(n_rows,)``, all as inequalities."""
        labels = tuple(label for label, keep in zip(self.labels, mask, strict=True) if keep)
        return LinearConstraints(self.matrix[mask], self.bound[mask], labels)


def stack_constraints(parts: Sequence[LinearConstraints], n_params: int) -> LinearConstraints:
    """Join constraints, equalities first.

    Args:
        parts: constraints on the same parameters; their order is kept.
        n_params: number of parameters, for where there are no parts.
    """
    equal = [(p.matrix[: p.n_equal], p.bound[: p.n_equal], p.labels[: p.n_equal]) for p in parts]
    other = [(p.matrix[p.n_equal :], p.bound[p.n_equal :], p.labels[p.n_equal :]) for p in parts]
    pieces = equal + other
    return LinearConstraints(
        np.vstack([piece[0] for piece in pieces] or [np.zeros((0, n_params))]),
        np.concatenate([piece[1] for piece in pieces] or [np.zeros(0)]),
        tuple(label for piece in pieces for label in piece[2]),
        sum(p.n_equal for p in parts),
    )
