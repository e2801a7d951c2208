"""The best three motions per degree of freedom."""

from __future__ import annotations

import numpy as np
import pytest

from excite.errors import InputError
from excite.excitation.conditioning import Ranking, motion_factor, rank
from excite.excitation.selection import best_three_per_dof
from excite.robot.robot import Robot
from tests.excitation.conftest import sines


@pytest.fixture
def ranking(panda: Robot) -> Ranking:
    names = tuple(segment.name for segment in panda.segments[:3])
    condition = np.array([[1.0, 9.0, np.inf], [2.0, 8.0, np.inf], [3.0, 7.0, np.inf], [4.0, 6.0, np.inf]])
    return Ranking(("m0", "m1", "m2", "m3"), names, condition, np.ones_like(condition))


def test_union_of_the_best(panda: Robot, ranking: Ranking) -> None:
    first, second, third = ranking.segments
    chosen = best_three_per_dof(panda, ranking, count=1)
    assert [(s.index, s.motion, s.segments) for s in chosen.selected] == [
        (0, "m0", (first,)),
        (3, "m3", (second,)),
    ]
    chosen = best_three_per_dof(panda, ranking)
    assert chosen.indices == (0, 1, 2, 3)
    assert chosen.selected[1].segments == (first, second)
    assert chosen.unserved == chosen.short == (third,)
    assert chosen.unseen == tuple(segment.name for segment in panda.segments[3:])


def test_order_of_the_candidates_does_not_matter(panda: Robot) -> None:
    factors = [motion_factor(panda, sines(panda, f"motion{i}", i, duration=2.0)) for i in range(6)]
    names = {s.motion for s in best_three_per_dof(panda, rank(panda, factors)).selected}
    assert names == {s.motion for s in best_three_per_dof(panda, rank(panda, factors[::-1])).selected}


def test_every_seen_segment_of_a_humanoid_is_served_thrice(g1: Robot) -> None:
    factors = [motion_factor(g1, sines(g1, f"motion{i}", i, duration=2.0), 25.0) for i in range(4)]
    chosen = best_three_per_dof(g1, rank(g1, factors))
    served = [name for motion in chosen.selected for name in motion.segments]
    assert chosen.unserved == chosen.short == ()
    assert all(served.count(segment) == 3 for segment in served)
    assert len(set(served)) == 28
    assert len(chosen.unseen) == 2


def test_faults(panda: Robot, ranking: Ranking) -> None:
    with pytest.raises(InputError, match="at least one"):
        best_three_per_dof(panda, ranking, count=0)
