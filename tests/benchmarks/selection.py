"""Three rules for the choice of motions, compared at equal total duration."""

from __future__ import annotations

import numpy as np

import excite
from excite.campaign.candidates import selection_candidates
from excite.campaign.expected import predict_statistics
from excite.campaign.optimised_series import Asked
from excite.excitation.conditioning import compute_conditioning
from excite.excitation.selection import SELECTIONS, Candidates, select_motions
from tests.benchmarks.table import Row

_ROBOTS = (("ur10", 40), ("g1", 50))
_RANDOM = 50


def rows() -> list[Row]:
    """What each rule's choice says about the parameters, and the log-determinant against random choices."""
    table = []
    for name, count in _ROBOTS:
        robot = excite.load_robot(name)
        plan = excite.plan(robot, n_candidates=count, seed=1, jobs=2)
        pool = selection_candidates(Asked(robot, count), plan.pool, plan.conditioning.base)
        found = {}
        for rule in SELECTIONS:
            chosen = list(select_motions(rule, pool).indices)
            motions = [plan.accepted[i] for i in chosen]
            judged = compute_conditioning(robot, [plan.factors[i] for i in chosen], plan.conditioning.base)
            rsd = list(predict_statistics(robot, motions).essential_rsd().values())
            found[rule] = judged.log_det
            worst = max(segment.condition for segment in judged.segments)
            table.append(
                Row(
                    f"{name}, {rule}: log-determinant, worst segment condition, predicted RSD (largest, median)",
                    f"{sum(motion.duration for motion in motions):.0f} s",
                    f"{judged.log_det:.1f}, {worst:.1f}, {max(rsd):.3g} %, {np.median(rsd):.3g} %",
                    None,
                )
            )
        best = _best_random(
            pool, float(pool.durations[list(select_motions("best_three", pool).indices)].sum())
        )
        table.append(
            Row.at_least(
                f"{name}: log-determinant of the greedy choice against the best of {_RANDOM} random ones",
                found["log_det"],
                best,
                digits=5,
            )
        )
    return table


def _best_random(pool: Candidates, budget_s: float) -> float:
    random, best = np.random.default_rng(0), -np.inf
    for _ in range(_RANDOM):
        chosen: list[int] = []
        for index in random.permutation(len(pool.durations)):
            if pool.durations[chosen].sum() + pool.durations[index] <= budget_s:
                chosen.append(int(index))
        best = max(
            best, compute_conditioning(pool.robot, [pool.factors[i] for i in chosen], pool.base).log_det
        )
    return best
