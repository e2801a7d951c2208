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


@pytest.mark.parametrize(("name", "spoil"), [(name, one) for name in ("ur10", "panda") for one in SPOILT])
def test_a_trial_that_is_not_like_the_others_is_named(name: str, spoil: Callable[[Trial], Trial]) -> None:
    robot = load_robot(name)
    log = arm_log(robot, 6)
    kinds = {found.kind for found in examine(robot, log).findings}
    assert "unexplained_torques" not in kinds
    second = replace(log, trials=(log.trials[0], spoil(log.trials[1]), log.trials[2]))
    (found,) = (one for one in examine(robot, second).findings if one.kind == "unexplained_torques")
    assert found.trials == ("trial_01",) and not found.repaired


def _off(trial: Trial, joint: int, angle: float) -> Trial:
    by = np.where(np.arange(trial.q.shape[1]) == joint, angle, 0.0)
    return replace(trial, q=trial.q + by, q_cmd=None)


@pytest.mark.parametrize("name", ["ur10", "panda", "iiwa14"])
@pytest.mark.parametrize("which", [0, 1, 2])
def test_a_zero_that_is_off_in_one_trial_moves_no_other(name: str, which: int) -> None:
    """20° and −40°, the judging trial's too: said of that trial with its size, the log left as it is."""
    robot = load_robot(name)
    log = arm_log(robot, 6)
    for angle in (0.35, -0.7):
        trials = tuple(_off(t, 1, angle) if k == which else t for k, t in enumerate(log.trials))
        chart = examine(robot, replace(log, trials=trials))
        (found,) = (one for one in chart.findings if one.severity == "spoils")
        joint = robot.joint_names[1]
        assert found.trials == (f"trial_{which:02d}",) and found.places == (joint,) and not found.repaired
        assert found.figures[f"add_{joint}_rad"] == pytest.approx(-angle, abs=0.02)
        for before, after in zip(trials, chart.log.trials, strict=True):
            np.testing.assert_array_equal(after.q, before.q)


def test_a_torque_that_is_turned_in_one_trial_is_said_of_that_trial() -> None:
    robot = load_robot("panda")
    log = arm_log(robot, 6)
    spoilt = replace(log, trials=(log.trials[0], _one_turned(log.trials[1]), log.trials[2]))
    (found,) = (one for one in examine(robot, spoilt).findings if one.kind == "unexplained_torques")
    assert "in trial_01 alone" in found.text and "opposite sign" in found.text
    assert found.places == ("panda_joint2",)


@pytest.mark.parametrize(("name", "joint"), [("ur10", 3), ("panda", 1), ("iiwa14", 2), ("jaco2", 1)])
def test_torques_without_sign_are_not_called_turned(name: str, joint: int) -> None:
    """Absolute values in every trial: the joint is read as without a torque."""
    robot = load_robot(name)
    log = arm_log(robot, 6)
    column = np.arange(robot.n_joints) == joint
    trials = tuple(replace(t, tau=np.where(column, np.abs(t.tau), t.tau)) for t in log.trials)
    chart = examine(robot, replace(log, trials=trials))
    (found,) = (one for one in chart.findings if one.severity in {"spoils", "limits"})
    assert found.kind == "unsigned_torques" and found.places == (robot.joint_names[joint],)
    assert chart.log.header.no_torque == (robot.joint_names[joint],)


def test_a_log_whose_torques_have_all_lost_their_sign_cannot_be_used() -> None:
    robot = load_robot("panda")
    log = arm_log(robot, 6)
    chart = examine(robot, replace(log, trials=tuple(map(_without_sign, log.trials))))
    assert not chart.usable
    assert {one.kind for one in chart.findings if one.severity in {"fatal", "spoils"}} == {"unsigned_torques"}
