"""Choice by the condition numbers of all segments, against trying every set of motions."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from excite.excitation.conditioning import MotionFactor, compute_conditioning, motion_factor, segment_columns
from excite.excitation.selection import choose_by_segments, segment_information
from excite.regressor.base_parameters import BaseParameters, structural_base_parameters
from excite.robot.robot import Robot
from tests.excitation.conftest import sines

_SECONDS = np.array([2.0, 3.0, 4.0, 2.0, 3.0, 4.0, 2.0, 3.0, 4.0])


@pytest.fixture(scope="module")
def base(panda: Robot) -> BaseParameters:
    return structural_base_parameters(panda)


@pytest.fixture(scope="module")
def factors(panda: Robot) -> list[MotionFactor]:
    """Nine motions, some of which move a few joints only."""
    return [
        motion_factor(
            panda,
            sines(panda, f"m{i}", i, moving=None if i % 3 else range(i % 6 + 2), duration=float(_SECONDS[i])),
            25.0,
        )
        for i in range(9)
    ]


def worst(panda: Robot, factors: list[MotionFactor], base: BaseParameters, chosen: tuple[int, ...]) -> dict:
    judged = compute_conditioning(panda, [factors[i] for i in chosen], base)
    return {segment.segment: segment.condition for segment in judged.segments}


def test_limits_that_some_set_of_three_reaches_are_reached(
    panda: Robot, factors: list[MotionFactor], base: BaseParameters
) -> None:
    columns = segment_columns(panda, factors[0].columns, base)
    known = segment_information(factors, columns)
    sets = [three for three in combinations(range(9), 3) if _SECONDS[list(three)].sum() <= 9.0]
    reached = {three: worst(panda, factors, base, three) for three in sets}
    best = min(sets, key=lambda three: sum(np.log(c) ** 2 for c in reached[three].values()))
    # What the best of all sets of three reaches is demanded of the choice, with a tenth of room.
    limits = {segment: 1.1 * condition / 0.9 for segment, condition in reached[best].items()}
    chosen = choose_by_segments(known, _SECONDS, 9.0, limits)
    found = worst(panda, factors, base, chosen)
    assert _SECONDS[list(chosen)].sum() <= 9.0
    assert all(found[segment] <= limit for segment, limit in limits.items())


def test_without_limits_it_beats_any_pair(
    panda: Robot, factors: list[MotionFactor], base: BaseParameters
) -> None:
    known = segment_information(factors, segment_columns(panda, factors[0].columns, base))

    def cost(chosen: tuple[int, ...]) -> float:
        return sum(np.log(c / 0.9) ** 2 for c in worst(panda, factors, base, chosen).values())

    chosen = choose_by_segments(known, _SECONDS, _SECONDS.sum())
    assert chosen == choose_by_segments(known, _SECONDS, _SECONDS.sum())
    assert cost(chosen) <= min(cost(pair) for pair in combinations(range(9), 2)) * 1.02


def test_nothing_is_chosen_where_nothing_fits(
    panda: Robot, factors: list[MotionFactor], base: BaseParameters
) -> None:
    known = segment_information(factors, segment_columns(panda, factors[0].columns, base))
    assert choose_by_segments(known, _SECONDS, 1.0) == ()
