"""Greedy choices against random and exhaustive ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from excite.errors import UnknownNameError
from excite.excitation.conditioning import (
    MotionFactor,
    compute_conditioning,
    motion_factor,
    rank,
    stack_factors,
)
from excite.excitation.precision import nominal_values, row_noise
from excite.excitation.selection import (
    SELECTIONS,
    Candidates,
    LogDeterminant,
    TotalDeviation,
    candidate_information,
    greedy_choice,
    select_motions,
)
from excite.excitation.targets import wanted_parameters
from excite.regressor.base_parameters import BaseParameters, structural_base_parameters
from excite.robot.robot import Robot
from tests.excitation.conftest import sines


@pytest.fixture(scope="module")
def base(panda: Robot) -> BaseParameters:
    return structural_base_parameters(panda)


@pytest.fixture(scope="module")
def candidates(panda: Robot, base: BaseParameters) -> Candidates:
    """Twelve motions of 2, 3 and 4 s, some of which move a few joints only."""
    motions = [
        sines(panda, f"motion{i}", i, moving=None if i % 3 else range(i % 7 + 1), duration=2.0 + i % 3)
        for i in range(12)
    ]
    factors = [motion_factor(panda, motion, 25.0) for motion in motions]
    noise = row_noise(panda)
    return Candidates(
        robot=panda,
        ranking=rank(panda, factors, base),
        factors=factors,
        durations=np.array([motion.duration for motion in motions]),
        base=base,
        weighted=lambda: ([motion_factor(panda, motion, 25.0, row_std=noise) for motion in motions], ()),
    )


def random_choices(durations: np.ndarray, budget_s: float, count: int) -> list[list[int]]:
    """Motions taken in random order as long as they fit."""
    random, found = np.random.default_rng(0), []
    for _ in range(count):
        chosen: list[int] = []
        for index in random.permutation(len(durations)):
            if durations[chosen].sum() + durations[index] <= budget_s:
                chosen.append(int(index))
        found.append(chosen)
    return found


def log_det(candidates: Candidates, chosen: list[int]) -> float:
    return compute_conditioning(
        candidates.robot, [candidates.factors[i] for i in chosen], candidates.base
    ).log_det


def total_deviation(candidates: Candidates, factors: Sequence[MotionFactor]) -> float:
    """Sum of relative standard deviations of motions together."""
    scale = np.maximum(np.abs(nominal_values(candidates.robot, candidates.base)), 0.01)
    whole = stack_factors(factors).matrix[:, candidates.base.independent]
    return float((np.linalg.norm(np.linalg.pinv(whole), axis=1) / scale).sum())


@pytest.mark.parametrize("budget_s", [8.0, 13.0, 20.0])
def test_no_random_choice_of_the_same_duration_has_a_larger_log_determinant(
    candidates: Candidates, budget_s: float
) -> None:
    known = candidate_information(candidates.factors, candidates.base)
    chosen = greedy_choice(known, LogDeterminant(), candidates.durations, budget_s)
    assert candidates.durations[list(chosen)].sum() <= budget_s + 1e-9
    greedy = log_det(candidates, list(chosen))
    others = [log_det(candidates, choice) for choice in random_choices(candidates.durations, budget_s, 100)]
    # A random choice may be the same motions in another order, summed with another rounding.
    assert greedy >= max(others) - 1e-9


def test_as_good_as_trying_every_choice(candidates: Candidates) -> None:
    known = candidate_information(candidates.factors, candidates.base)
    # The last three cost too much.
    price = np.where(np.arange(12) < 9, 1.0, 9.0)
    chosen = greedy_choice(known, LogDeterminant(), price, 3.0)
    best = max(log_det(candidates, list(three)) for three in combinations(range(9), 3))
    assert len(chosen) == 3
    assert log_det(candidates, list(chosen)) >= best - 0.5


def test_the_choice_by_rsd_has_the_least_of_the_three(candidates: Candidates) -> None:
    weighted, _ = candidates.weighted()
    totals = {}
    for rule in SELECTIONS:
        chosen = select_motions(rule, candidates).indices
        assert chosen == select_motions(rule, candidates).indices
        totals[rule] = total_deviation(candidates, [weighted[i] for i in chosen])
    assert totals["rsd"] <= min(totals.values())


def test_what_was_run_before_counts_in_the_choice(candidates: Candidates) -> None:
    weighted, _ = candidates.weighted()
    short = replace(candidates, budget_s=13.0)
    first = select_motions("rsd", short).indices
    known = [weighted[i] for i in first]
    then = select_motions("rsd", replace(short, weighted=lambda: (weighted, known))).indices
    assert then != first
    totals = [total_deviation(candidates, [*known, *(weighted[i] for i in more)]) for more in (then, first)]
    assert totals[0] < totals[1]


def test_gradients_are_those_of_the_criteria(candidates: Candidates) -> None:
    known = candidate_information(candidates.factors, candidates.base)
    matrix, step = known.of(range(6)), 1e-4 * known.single[7]
    scale = np.maximum(np.abs(nominal_values(candidates.robot, candidates.base)), 0.01)
    for criterion in (LogDeterminant(), TotalDeviation(known.back, scale)):
        change = criterion.value(matrix + step) - criterion.value(matrix - step)
        assert change == pytest.approx(2.0 * np.sum(criterion.gradient(matrix) * step), rel=1e-3)


def test_best_three_is_what_greedy_choices_are_compared_with(candidates: Candidates) -> None:
    seconds = {
        rule: candidates.durations[list(select_motions(rule, candidates).indices)].sum()
        for rule in SELECTIONS
    }
    assert max(seconds["log_det"], seconds["rsd"]) <= seconds["best_three"] + 1e-9


def test_unknown_rule(candidates: Candidates) -> None:
    with pytest.raises(UnknownNameError, match=r"unknown selection 'worst'; choose one of best_three"):
        select_motions("worst", candidates)


@pytest.mark.parametrize("reached", [2, 4, 8, 12])
@pytest.mark.parametrize("far", [6.0, 20.0, 60.0])
def test_seconds_go_to_targets_that_some_choice_reaches(
    candidates: Candidates, reached: int, far: float
) -> None:
    """One motion tells a few targets within their goals, one brings all others from far above theirs to less far."""
    base, rsd = candidates.base, 15.0
    first = candidates.factors[0]
    wanted = wanted_parameters(candidates.robot, base, ())
    values = np.abs(nominal_values(candidates.robot, base))
    goal = 0.01 * rsd * values / np.sqrt(first.rate_hz / candidates.rows_hz)
    some = np.flatnonzero(wanted)[:reached]

    def factor(name: str, ratio: np.ndarray) -> MotionFactor:
        rows = np.zeros_like(first.matrix)
        rows[base.independent, base.independent] = 1.0 / (ratio * np.maximum(goal, 1e-3))
        return replace(first, motions=(name,), matrix=rows)

    weak = np.full(len(wanted), 1e4)
    few, many = weak.copy(), np.full(len(wanted), far)
    few[some], many[some] = 0.7, 1e4
    factors = [factor("many", many), factor("few", few), factor("none", weak)]
    asked = replace(
        candidates,
        ranking=rank(candidates.robot, factors, base),
        factors=factors,
        durations=np.full(3, 5.0),
        weighted=lambda: (factors, ()),
        budget_s=5.0,
        target_rsd=rsd,
    )
    assert select_motions("targets", asked).indices == (1,)
    # Where none is reached they all count as they did.
    none = [factor("weak", weak), factor("many", many)]
    asked = replace(
        asked,
        ranking=rank(candidates.robot, none, base),
        factors=none,
        durations=np.full(2, 5.0),
        weighted=lambda: (none, ()),
    )
    assert select_motions("targets", asked).indices == (1,)
