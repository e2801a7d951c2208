"""Order of motions by segment."""

from __future__ import annotations

import numpy as np
import pytest

from excite.errors import InputError, UnknownNameError
from excite.excitation.conditioning import Ranking, compute_conditioning, motion_factor, rank
from excite.robot.robot import Robot
from tests.excitation.conftest import sines


def test_ranking_is_each_motions_own_conditioning(panda: Robot) -> None:
    motions = [sines(panda, f"motion{i}", i) for i in range(3)] + [sines(panda, "wrist", 9, moving=[5, 6])]
    factors = [motion_factor(panda, motion) for motion in motions]
    ranking = rank(panda, factors)
    for m, factor in enumerate(factors):
        own = compute_conditioning(panda, [factor]).segments
        np.testing.assert_array_equal(ranking.condition[m], [s.condition for s in own])
    last = ranking.segments[-1]
    best = ranking.best(last)
    conditions = [ranking.condition[m, -1] for m in best]
    assert conditions == sorted(conditions)


def test_equals_are_told_apart_by_strength_then_name_then_place() -> None:
    ranking = Ranking(
        motions=("b", "a", "c", "c", "lame"),
        segments=("arm",),
        condition=np.array([[2.0], [2.0 + 1e-13], [2.0], [2.0], [np.inf]]),
        smallest=np.array([[1.0], [1.0], [3.0], [3.0 + 1e-12], [9.0]]),
    )
    assert ranking.best("arm") == (2, 3, 1, 0)


def test_faults(panda: Robot, g1: Robot) -> None:
    with pytest.raises(InputError, match="no motion"):
        rank(panda, [])
    own, other = (
        motion_factor(panda, sines(panda, "m", 0)),
        motion_factor(g1, sines(g1, "m", 0, duration=1.0)),
    )
    with pytest.raises(InputError, match="different robots"):
        rank(panda, [own, other])
    with pytest.raises(InputError, match="other columns"):
        rank(panda, [other])
    ranking = rank(panda, [motion_factor(panda, sines(panda, "motion", 0))])
    with pytest.raises(UnknownNameError, match="tail"):
        ranking.best("tail")
