"""Fits that do not see the validation trials."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.diagnosis.floating.problem import Problem
from excite.diagnosis.floating.refinement import Fitted, explained_state, nominal_fit, refine


def identification_only(problem: Problem) -> Problem:
    """The problem with the validation trials' rows at zero weight; itself where there are no such trials."""
    if not any(problem.record.validation) or all(problem.record.validation):
        return problem
    keep = ~np.array(problem.record.validation)
    weight = np.where(problem.validation, 0.0, 1.0)
    whitening = replace(
        problem.whitening,
        factors=tuple(f * float(k) for f, k in zip(problem.whitening.factors, keep, strict=True)),
    )
    unloaded = replace(
        problem.unloaded,
        # An infinite standard deviation takes a row out.
        std=tuple(
            std if keep[trial] else np.full(6, np.inf)
            for std, trial in zip(problem.unloaded.std, problem.unloaded.trial, strict=True)
        ),
    )
    columns = problem.columns * weight[:, None]
    u, s, _ = np.linalg.svd(columns, full_matrices=False) if columns.size else (columns, np.zeros(0), None)
    return replace(
        problem,
        whitening=whitening,
        unloaded=unloaded,
        columns=columns,
        basis=u * (s / np.sqrt(1.0 + s**2)) if columns.size else columns,
    )


def refit(problem: Problem, fitted: Fitted) -> tuple[Fitted, Fitted]:
    """The baseline and a hypothesis fitted to the identification trials alone."""
    restricted = identification_only(problem)
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
    restricted = identification_only(problem)
    baseline = nominal_fit(restricted)
    powers = []
    for fitted in (without, candidate):
        alone = refine(restricted, fitted.placed, fitted.theta, fitted) if fitted.placed else baseline
        rows = problem.rows(explained_state(problem, alone))
        powers.append(float((rows[problem.validation] ** 2).sum()))
    return powers[0] - powers[1]
