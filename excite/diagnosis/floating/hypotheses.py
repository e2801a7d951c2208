"""Gauss-Newton on the full equations: what a hypothesis of one or more effects can really explain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.effect import FloatingEffect
from excite.diagnosis.floating.problem import Problem
from excite.diagnosis.floating.state import State

# A resonance is narrow, and takes the most.
_MAX_STEPS = 10
_CONVERGED_NATS = 0.5


@dataclass(frozen=True, eq=False)
class Placed:
    """An effect at a place."""

    effect: FloatingEffect
    location: str


@dataclass(frozen=True, eq=False)
class Fitted:
    """A hypothesis fitted to all trials.

    Attributes:
        placed: its effects.
        theta: parameters of each effect, in their units.
        std: standard deviations of the same.
        delta: errors of the inertial parameters, ``(10·n_segments,)``.
        power: sum of squares that it leaves, priors included.
        evidence: log Bayes factor against the baseline for unit noise [nats].
        price: the part of it that its parameters cost [nats].
    """

    placed: tuple[Placed, ...]
    theta: tuple[Array, ...]
    std: tuple[Array, ...]
    delta: Array
    power: float
    evidence: float
    price: float


def nominal_fit(problem: Problem) -> Fitted:
    """The baseline alone."""
    rows = problem.nominal_rows
    return Fitted((), (), (), problem.baseline_parameters(rows), problem.residual_power(rows), 0.0, 0.0)


def apply_all(state: State, placed: tuple[Placed, ...], theta: tuple[Array, ...]) -> State:
    """The state with all effects in it, in order."""
    for item, values in zip(placed, theta, strict=True):
        state = item.effect.apply_to(state, item.location, values)
    return state


def explained_state(problem: Problem, fitted: Fitted) -> State:
    """The record's state with a fit's inertials and effects."""
    state = problem.state_with_errors(fitted.delta)
    return apply_all(state, fitted.placed, fitted.theta)


def refine_fit(
    problem: Problem,
    placed: tuple[Placed, ...],
    start: tuple[Array, ...],
    before: Fitted,
    steps: int = _MAX_STEPS,
) -> Fitted:
    """Iterate linearised fits until they gain nothing.

    Args:
        placed: the effects.
        start: their parameters to begin with.
        before: a fit whose inertial parameters to begin with.
        steps: at most.

    Returns:
        The best point that was evaluated in full.
    """
    counts = [len(values) for values in start]
    scales = np.concatenate([p.effect.parameter_scales(problem.nominal, p.location) for p in placed])
    theta, delta = np.concatenate(start), before.delta
    state = problem.state_with_errors(delta)
    rows = _residual_rows(problem, state, placed, theta, counts)
    cost = _penalised_cost(problem, rows, theta / scales, delta)
    price, std = 0.0, np.zeros_like(theta)
    for _ in range(steps):
        columns = _stack_columns(problem, state, placed, theta, counts)
        target = rows + problem.baseline_rows(delta) + columns @ (theta / scales)
        fit = problem.fit_columns(target, columns)
        price, std = fit.gain - fit.evidence, scales * np.sqrt(np.diag(fit.covariance))
        step, best = 1.0, None
        aim = scales * fit.theta
        aim_delta = problem.baseline_parameters(target - columns @ fit.theta)
        while step > 0.05:
            trial, trial_delta = theta + step * (aim - theta), delta + step * (aim_delta - delta)
            trial_state = problem.state_with_errors(trial_delta)
            trial_rows = _residual_rows(problem, trial_state, placed, trial, counts)
            trial_cost = _penalised_cost(problem, trial_rows, trial / scales, trial_delta)
            if trial_cost < cost:
                best = (trial, trial_delta, trial_state, trial_rows, trial_cost)
                break
            step *= 0.4
        if best is None:
            break
        gained = 0.5 * (cost - best[-1])
        theta, delta, state, rows, cost = best
        if gained < _CONVERGED_NATS * max(1.0, cost / len(rows)):
            break
    null = nominal_fit(problem).power
    price += sum(item.effect.price for item in placed)
    parts = _split_parameters(theta, counts)
    return Fitted(
        placed, parts, _split_parameters(std, counts), delta, cost, 0.5 * (null - cost) - price, price
    )


def columns_of(problem: Problem, fitted: Fitted) -> Array:
    """``(m, k)`` whitened columns of a fit's effects at their parameters, in units of their scales."""
    counts, theta = [len(values) for values in fitted.theta], np.concatenate(fitted.theta)
    return _stack_columns(problem, problem.state_with_errors(fitted.delta), fitted.placed, theta, counts)


def _residual_rows(
    problem: Problem, state: State, placed: tuple[Placed, ...], theta: Array, counts: list[int]
) -> Array:
    return problem.residual_rows(apply_all(state, placed, _split_parameters(theta, counts)))


def _stack_columns(
    problem: Problem, state: State, placed: tuple[Placed, ...], theta: Array, counts: list[int]
) -> Array:
    columns, parts = [], _split_parameters(theta, counts)
    for item, values in zip(placed, parts, strict=True):
        columns.append(effect_columns(problem, state, item.effect, item.location, values))
        state = item.effect.apply_to(state, item.location, values)
    return np.hstack(columns)


def _penalised_cost(problem: Problem, rows: Array, scaled: Array, delta: Array) -> float:
    base = delta[problem.index] / problem.scales if len(problem.index) else np.zeros(0)
    return float(rows @ rows + scaled @ scaled + base @ base)


def _split_parameters(values: Array, counts: list[int]) -> tuple[Array, ...]:
    return tuple(np.split(values, np.cumsum(counts)[:-1]))


# Every effect at every place, linearised once: which deserve a closer look.


def effect_columns(
    problem: Problem, state: State, effect: FloatingEffect, location: str, theta: Array
) -> Array:
    """Whitened columns of an effect in units of its scales, unloaded sensors included, ``(m, k)``."""
    base = problem.whitening(effect.residual_columns(state, location, theta))
    unloaded = np.zeros((6 * len(problem.unloaded.sensors), base.shape[1]))
    if len(unloaded) and effect.changes == "readings":
        here = problem.unloaded.scaled_residual(effect.apply_to(state, location, theta))
        for i, parameter in enumerate(effect.parameters_at(state, location)):
            ahead = theta.copy()
            ahead[i] += parameter.step
            there = problem.unloaded.scaled_residual(effect.apply_to(state, location, ahead))
            unloaded[:, i] = (here - there) / parameter.step
    return np.vstack([base, unloaded]) * effect.parameter_scales(state, location)
