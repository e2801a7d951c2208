"""Each mass stays within a share of its reference (eq. 16 of Jovic et al., T-RO 2016)."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.problem import IdentificationProblem


def masses_in_range(problem: IdentificationProblem, shares: Array) -> LinearConstraints:
    """``(1 − β) m_ref ≤ m ≤ (1 + β) m_ref`` for each segment.

    Args:
        problem: the problem; its prior is the reference.
        shares: β of each segment, ``(n_segments,)``.
    """
    n = len(problem.robot.segments)
    matrix, bound = np.zeros((2 * n, problem.n_params)), np.zeros(2 * n)
    labels = []
    for index, segment in enumerate(problem.robot.segments):
        nominal = problem.prior[10 * index]
        matrix[2 * index : 2 * index + 2, 10 * index] = 1.0, -1.0
        bound[2 * index : 2 * index + 2] = (1.0 - shares[index]) * nominal, -(1.0 + shares[index]) * nominal
        labels += [f"mass_range:{segment.link}"] * 2
    return LinearConstraints(matrix, bound, tuple(labels))
