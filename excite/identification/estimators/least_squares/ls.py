"""Least squares, every row counted alike (eq. 5, Jovic et al. 2016; eq. 6, Xu et al. 2020)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.identification.estimators.base import Estimate, Estimator, SolveStatus
from excite.identification.estimators.checked import finite_or_raised
from excite.identification.estimators.setting import word
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import condense_problem, least_squares, prior_std


@dataclass(frozen=True)
class LsSettings(EstimatorSettings):
    """Settings of ``ls``.

    Attributes:
        ls_reference: ``zero`` is ``Y⁺f`` (eq. 5 of Jovic et al. 2016), ``nominal`` counts distances in units of
            the spreads.
    """

    ls_reference: str = word("zero", ("zero", "nominal"), "which of equally good solutions is given")


class LeastSquares(Estimator[LsSettings]):
    """Least squares, of all solutions the one of minimum norm ``φ = Y⁺ f`` or the one nearest to nominal.

    Only its base parameters mean anything: which of the solutions is given is a convention.
    """

    name: ClassVar[str] = "ls"
    title: ClassVar[str] = "least squares, minimum norm"
    use: ClassVar[str] = (
        "comparison with textbooks: channels of one unit and equal noise, base parameters alone"
    )
    settings_class: ClassVar[type[EstimatorSettings]] = LsSettings
    guarantees: ClassVar[str] = (
        "no parameters fit the unweighted rows better; bodies need not be able to exist"
    )

    def estimate(self, problem: IdentificationProblem, settings: LsSettings) -> Estimate:
        """See :meth:`Estimator.estimate`. Unmeasured segments keep nominal values."""
        rows = condense_problem(problem)
        if settings.ls_reference == "nominal":
            scales = prior_std(problem, settings.spreads(problem.robot))
            parameters = least_squares(rows.factor, center=problem.prior, scales=scales)
        else:
            parameters = least_squares(rows.factor)
        for segment in problem.unmeasured:
            columns = problem.robot.parameter_columns(segment)
            parameters[columns] = problem.prior[columns]
        residual = float(np.sqrt(np.mean(problem.residual(parameters) ** 2)))
        return finite_or_raised(Estimate(self.name, parameters, SolveStatus.SOLVED, rows, residual))
