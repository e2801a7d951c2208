"""Trials whose torques no bodies near the model's explain, beside others that they explain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from excite.doctor.examine import examine
from excite.logs.log import Trial
from excite.robot.load import load_robot
from tests.identification.practice_log import arm_log

N = 800


def _turned(trial: Trial) -> Trial:
    return replace(trial, tau=-trial.tau)


def _one_turned(trial: Trial) -> Trial:
    return replace(trial, tau=trial.tau * np.where(np.arange(trial.tau.shape[1]) == 1, -1.0, 1.0))


def _moved_zero(trial: Trial) -> Trial:
    return replace(trial, q=trial.q + np.where(np.arange(trial.q.shape[1]) == 1, 0.7, 0.0), q_cmd=None)


def _zeroed_underway(trial: Trial) -> Trial:
    q = trial.q.copy()
    q[N // 2 :, 1] -= q[N // 2, 1]
    return replace(trial, q=q, q_cmd=None)


def _of_another_run(trial: Trial) -> Trial:
    return replace(trial, tau=np.roll(trial.tau, N // 2, axis=0))


def _without_sign(trial: Trial) -> Trial:
    return replace(trial, tau=np.abs(trial.tau))


SPOILT = (_turned, _one_turned, _moved_zero, _zeroed_underway, _of_another_run, _without_sign)


# A zero that one of two trials of the Panda has elsewhere is found in both, by half: the doctor then moves all of them.
@pytest.mark.parametrize(
    ("name", "spoil"),
    [(name, one) for name in ("ur10", "panda") for one in SPOILT if (name, one) != ("panda", _moved_zero)],
)
def test_a_trial_that_is_not_like_the_others_is_named(name: str, spoil: Callable[[Trial], Trial]) -> None:
    robot = load_robot(name)
    log = arm_log(robot, 6)
    kinds = {found.kind for found in examine(robot, log).findings}
    assert "unexplained_torques" not in kinds
    second = replace(log, trials=(log.trials[0], spoil(log.trials[1]), log.trials[2]))
    (found,) = (one for one in examine(robot, second).findings if one.kind == "unexplained_torques")
    assert found.trials == ("trial_01",) and not found.repaired
