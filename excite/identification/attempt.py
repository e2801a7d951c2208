"""An estimate or, where its solver fails, the best that is known, with the failure beside it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numpy.linalg import LinAlgError

from excite.errors import LogError, NoSolutionError
from excite.finding import Finding
from excite.identification.estimators.base import Estimate, Estimator, SolveStatus
from excite.identification.estimators.checked import no_solution
from excite.identification.estimators.fallback import estimate_at
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression
from excite.logs.log import Log


def attempt_estimate(
    estimator: Estimator[Any], problem: IdentificationProblem, settings: EstimatorSettings, rows: Regression
) -> tuple[Estimate, NoSolutionError | None]:
    """Estimate; a failure comes with the best point known, the nominal model where there is no other.

    Args:
        estimator: the estimator.
        problem: the rows.
        settings: its settings.
        rows: the rows condensed and weighted, for the residual of the nominal model.

    Returns:
        The estimate, and None or the error of its solver.
    """
    try:
        return estimator.estimate(problem, settings), None
    except NoSolutionError as error:
        failure = error
    except LinAlgError as error:
        nominal = estimate_at(estimator.name, rows, problem.prior.copy(), SolveStatus.NOT_FINITE)
        failure = no_solution(SolveStatus.NOT_FINITE, nominal)
        failure.__cause__ = error
    if isinstance(failure.best, Estimate):
        return failure.best, failure
    return estimate_at(estimator.name, rows, problem.prior.copy(), SolveStatus.INFEASIBLE), failure


def failure_finding(failure: NoSolutionError) -> Finding:
    """What a reader of the parameters has to know first."""
    return Finding(
        "no_solution", f"{failure.what}: these parameters are only the best that is known, do not use them"
    )


@contextmanager
def equations_of(log: Log) -> Iterator[None]:
    """Say of a log whose equations cannot be solved, not even by the nominal model's side, what is likely wrong.

    Numbers of sixteen digits cannot hold channels that are further apart than any two of one robot.

    Raises:
        LogError: what is done in the block raised LinAlgError.
    """
    try:
        yield
    except LinAlgError as error:
        raise LogError(
            f"its equations cannot be solved ({' '.join(str(error).split())})",
            source=log.folder,
            remedy="a channel is in another unit or all noise: see `excite diagnose`, or plot the torques",
        ) from error
