"""Curves of the wrench on the base."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.answer.curves import Curves
from excite.diagnosis.floating.answer.gap import UNITS
from excite.diagnosis.floating.equations.problem import Problem
from excite.diagnosis.floating.search.refinement import Fitted, explained_state
from excite.logs.columns import WRENCH_AXES


def trial_curves(problem: Problem, before: Fitted, after: Fitted) -> Curves:
    """The wrench on the base in the first validation trial, in the first trial where there is none.

    Args:
        problem: the problem.
        before: the baseline's fit.
        after: the fit with the effects.
    """
    record = problem.record
    chosen = next((k for k, outside in enumerate(record.validation) if outside), 0)
    span = record.spans[chosen]
    measured = problem.nominal.measured[span]
    return Curves(
        trial=record.trials[chosen],
        validation=record.validation[chosen],
        channels=tuple(WRENCH_AXES),
        units=UNITS,
        time=np.arange(len(measured)) / record.rate_hz,
        measured=measured,
        before=measured - explained_state(problem, before).residual[span],
        after=measured - explained_state(problem, after).residual[span],
    )
