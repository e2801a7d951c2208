"""Fits that do not see the validation trials."""

from __future__ import annotations

from excite.diagnosis.floating.equations.problem import Problem
from excite.diagnosis.floating.search.refinement import Fitted, explained_state, nominal_fit, refine


def refit(problem: Problem, fitted: Fitted) -> tuple[Fitted, Fitted]:
    """The baseline and a hypothesis fitted to the identification trials alone."""
    restricted = problem.identification_only
    baseline = nominal_fit(restricted)
    if not fitted.placed:
        return baseline, baseline
    return baseline, refine(restricted, fitted.placed, fitted.theta, fitted)


def held_out_gain(problem: Problem, without: Fitted, candidate: Fitted) -> float:
    """What a further effect takes away from the validation trials' sum of squares, fitted to the others.

    Positive infinity where there are no validation trials: nothing speaks against it.
    """
    if not problem.validation.any() or problem.validation.all():
        return float("inf")
    restricted = problem.identification_only
    baseline = nominal_fit(restricted)
    powers = []
    for fitted in (without, candidate):
        alone = refine(restricted, fitted.placed, fitted.theta, fitted) if fitted.placed else baseline
        rows = problem.rows(explained_state(problem, alone))
        powers.append(float((rows[problem.validation] ** 2).sum()))
    return powers[0] - powers[1]
