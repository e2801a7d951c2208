"""Several logs as one: names are told apart, and so are rates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.doctor.checks.clock import StatedRate
from excite.errors import InputError, LogError
from excite.logs.files import load_log, save_log
from excite.logs.load_with_robot import join_logs
from excite.logs.log import Log, Trial
from excite.logs.robot import nominal_robot
from excite.robot.robot import Robot
from tests.diagnosis.two_joints import RATE_HZ, moved, two_joint_log


@pytest.fixture(scope="module")
def trial() -> Trial:
    return moved("run", "identification", 4.0, np.random.default_rng(0), np.eye(2))


@pytest.fixture(scope="module")
def robot(trial: Trial, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return nominal_robot(load_log(save_log(two_joint_log((trial,)), tmp_path_factory.mktemp("log"))))


def every_other(trial: Trial) -> Trial:
    assert trial.tau is not None
    return replace(trial, time=trial.time[::2], q=trial.q[::2], tau=trial.tau[::2])


def rate_findings(robot: Robot, log: Log) -> list[str]:
    return [finding.kind for finding in StatedRate().examine(robot, log).findings]


def test_logs_of_several_rates_are_no_wrong_clock(trial: Trial, robot: Robot) -> None:
    slow = two_joint_log((every_other(trial),), rate_hz=RATE_HZ / 2)
    joined = join_logs([two_joint_log((trial,)), slow])
    assert [one.name for one in joined.trials] == ["run", "run_2"]
    assert rate_findings(robot, joined) == []
    # A rate that is stated wrongly is found among several too.
    wrong = two_joint_log((every_other(trial),), rate_hz=RATE_HZ)
    assert rate_findings(robot, join_logs([two_joint_log((trial,)), wrong])) == ["rate"]


def test_logs_of_different_machines_are_not_joined(trial: Trial, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="gravity: differs from the first log"):
        join_logs([two_joint_log((trial,)), two_joint_log((trial,), gravity=[0.0, 0.0, -1.6])])
    with pytest.raises(InputError, match="no log"):
        join_logs([])
