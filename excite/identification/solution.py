"""How an identification's parameters were found, and what is proven of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.identification.estimators.base import Estimate, SolveStatus
from excite.identification.physical.certificate import Certificate


@dataclass(frozen=True, eq=False)
class Solution:
    """How the parameters were found.

    Attributes:
        method: registry name of the estimator.
        status: advice on how the solve ended.
        solved: whether the estimator's answer passed its recomputation; what did not is no result.
        n_samples: instants that were used.
        violations: largest violation of each kind of constraint, recomputed; in the estimator's units.
        certificate: what is proven of the method's objective, None where it is convex.
        total_mass: that was imposed on the sum of all masses [kg], None where it was free.
    """

    method: str
    status: str
    solved: bool
    n_samples: int
    violations: dict[str, float]
    certificate: Certificate | None
    total_mass: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Its blocks of the document."""
        return {
            "method": self.method,
            "status": self.status,
            "solved": self.solved,
            "violations": self.violations,
            "certificate": None if self.certificate is None else self.certificate.to_json(),
            "n_samples": self.n_samples,
        }


def solution_of(estimate: Estimate) -> Solution:
    """What an estimate says of itself."""
    problem = estimate.regression.problem
    return Solution(
        method=estimate.method,
        status=estimate.status.value,
        solved=estimate.status is SolveStatus.SOLVED,
        n_samples=len(np.unique(np.column_stack([problem.trial, problem.time]), axis=0)),
        violations=dict(estimate.violations or {}),
        certificate=estimate.certificate,
        total_mass=estimate.total_mass,
    )
