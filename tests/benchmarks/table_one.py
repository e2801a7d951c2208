"""Condition numbers of every segment's sub-regressor on the HRP-2-like robot, beside those published for HRP-2.

Jovic et al. 2015 (IROS), Table I, row HRP-2: sub-regressors of the base link's equation, ten columns a segment,
numbered as in its Figure 2c. Feet count there, so that the columns behind the ankle sensors count here too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from excite.campaign.candidates import Rule, choose_motions, selection_candidates
from excite.campaign.pool import Keeper, Pool, ranked_segments
from excite.excitation.conditioning import compute_conditioning
from excite.excitation.selection import select_motions
from excite.motion.generators.mixture import plan_candidates
from excite.progress import silent
from excite.regressor.base_parameters import BaseParameters, structural_base_parameters
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.filter import filter_candidates
from excite.temporary_folder import TemporaryFolder
from tests.benchmarks.constraint_cost import STEPS, ladder
from tests.benchmarks.table import Row
from tests.reproduction.hrp2 import CONDITION_NUMBERS

_WORST = 60.0
# A row counts as far from what no constraint would allow from this factor on.
_FAR = 1.5
_SECONDS = 200.0
_CANDIDATES, _SEED = 160, 1
# The rows of the legs are those that come near to the bars: motions that carry them, and some that do not.
_MIX = {"leg_swing": 0.6, "squat": 0.4}


def rows() -> list[Row]:
    """Choose motions of at most 200 s for the table's rows, and print it with the best three of each segment beside."""
    robot = on_force_plates(load_robot("hrp2like"))
    base = structural_base_parameters(robot)
    segments = sorted(segment.name for segment in robot.segments)
    bars = np.minimum(CONDITION_NUMBERS, _WORST)
    pool = _pool(robot)
    rule = Rule("segments", _SECONDS, dict(zip(segments, bars.tolist(), strict=True)))
    choice = choose_motions(robot, pool, base, rule, 2, silent)
    best = select_motions("best_three", selection_candidates(robot, choice.pool, base, rule)).indices
    chosen = choice.selection.indices
    found, three = (_conditions(robot, choice.pool, base, segments, pick) for pick in (chosen, best))
    steps = ladder(robot, base, choice.pool.motions.only(chosen))
    relaxed = [np.array([steps[step][segment] for segment in segments]) for step in STEPS]
    durations = choice.pool.durations
    seconds = float(durations[list(chosen)].sum())
    table = [
        Row(
            f"HRP-2-like robot: {len(chosen)} of {len(pool.entries)} motions chosen by segments and rehearsed; best "
            "three of each segment",
            "≤ 200 s",
            f"{seconds:.0f} s; {len(best)} motions, {durations[list(best)].sum():.0f} s",
            seconds <= _SECONDS,
        )
    ]
    for index, (published, bar) in enumerate(zip(CONDITION_NUMBERS, bars, strict=True)):
        costs = ", ".join(f"{values[index]:.1f}" for values in relaxed)
        reached = f"{found[index]:.1f} (best three: {three[index]:.1f}; {costs})"
        table.append(
            Row(f"… segment {index + 1}, HRP-2 {published}", f"≤ {bar:g}", reached, bool(found[index] <= bar))
        )
    met = int((found <= bars).sum())
    table.append(
        Row.at_least("… segments at or below the published number and 60", met, len(CONDITION_NUMBERS))
    )
    table.append(Row("… in brackets, of random states", ", ".join(STEPS), _dearest(relaxed, found), None))
    return table


def _dearest(relaxed: list[np.ndarray], found: np.ndarray) -> str:
    """For the rows that stay far from what no constraint would allow: which step costs most."""
    ratios = np.array([after / before for before, after in pairwise([*relaxed, found])])
    far = found > _FAR * relaxed[0]
    names = (*STEPS[1:], "balance, drives and smooth paths")
    most = ratios[:, far].argmax(axis=0)
    counted = [
        f"{(most == step).sum()} times {name} (a factor {np.median(ratios[step, far][most == step]):.1f})"
        for step, name in enumerate(names)
        if (most == step).any()
    ]
    return f"above {_FAR:g} times the first: {far.sum()} rows; what costs most: {', '.join(counted) or 'nothing'}"


def on_force_plates(robot: Robot) -> Robot:
    """The robot with nothing hidden behind its ankle sensors."""
    return replace(robot, sensors=tuple(replace(s, excludes=()) for s in robot.sensors))


def _pool(robot: Robot) -> Pool:
    drawn = plan_candidates(robot, _CANDIDATES, np.random.SeedSequence(_SEED), mix=_MIX)
    folder = TemporaryFolder()
    kept = filter_candidates(robot, drawn, jobs=2, keep=Keeper(folder.path)).kept
    return Pool(kept, folder, ranked_segments(robot))


def _conditions(
    robot: Robot, pool: Pool, base: BaseParameters, segments: Sequence[str], chosen: Sequence[int]
) -> np.ndarray:
    """Condition numbers over several motions, in the table's order, ``(31,)``."""
    judged = compute_conditioning(robot, pool.factors.only(chosen), base)
    found = {segment.segment: segment.condition for segment in judged.segments}
    return np.array([found[segment] for segment in segments])
