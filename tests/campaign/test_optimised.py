"""Plans of optimised series: what is aimed at, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.campaign import optimised_series as optimised
from excite.campaign.optimised_series import Asked, OptimisedSeries
from excite.campaign.plan import plan
from excite.errors import InputError
from excite.excitation.series import ExcitationTask
from excite.excitation.series_search import SearchResult, SearchSettings, optimise_excitation
from excite.motion.generators.generator import central_range
from excite.robot.robot import Robot


def test_series_aim_at_joints_in_turn(ur10: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a search that stops early at its first optimum: how good it is does not matter here."""

    def quick(task: ExcitationTask, search: SearchSettings, **told: object) -> SearchResult:
        return optimise_excitation(task, replace(search, kicks=0, effort=0.02), **told)

    monkeypatch.setattr(optimised, "optimise_excitation", quick)
    aimed = ("wrist_2_joint", "elbow_joint")
    made = OptimisedSeries().candidates(Asked(ur10, 2, aimed), 3)
    assert [candidate.targets for candidate in made] == [(joint,) for joint in aimed]
    assert len({candidate.name for candidate in made}) == 2
    lower, upper = central_range(ur10)
    for candidate in made:
        path = candidate.posture.evaluate(np.linspace(0.0, candidate.posture.length, 500))
        used = (path.max(axis=0) - path.min(axis=0)) / (upper - lower)
        others = [joint not in candidate.targets for joint in ur10.joint_names]
        assert used[others].max() <= 0.4 + 1e-6


def test_a_robot_that_stands_has_no_series(g1: Robot) -> None:
    with pytest.raises(InputError, match=r"arms with a motor in every joint.*another generator"):
        OptimisedSeries().candidates(Asked(g1, 1), 0)


def test_settings_that_do_not_go_together_are_refused(ur10: Robot) -> None:
    with pytest.raises(InputError, match="best three"):
        plan(ur10, n_candidates=1, budget_s=10.0)
    with pytest.raises(InputError, match="budget: is -1"):
        plan(ur10, n_candidates=1, selection="log_det", budget_s=-1.0)
