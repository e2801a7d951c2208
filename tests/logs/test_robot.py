"""The nominal model that a log names: what no body has is said, what is at rest does not matter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.doctor.examine import examine
from excite.errors import InputError, LogError, RobotError
from excite.logs.files import load_log, save_log
from excite.logs.header_blocks import TrialHeader
from excite.logs.load_with_robot import join_logs
from excite.logs.log import Log, Trial
from excite.logs.robot import bare_description, nominal_faults, nominal_robot, robot_for_log
from excite.robot.loading import build_robot, load_robot
from excite.robot.robot import Robot
from excite.simulation.sensing import log_header
from tests.diagnosis.two_joints import RATE_HZ, moved, two_joint_log
from tests.logs.conftest import ARM

FORE = '<inertia ixx="0.01" iyy="0.01" izz="0.004" ixy="0" ixz="0" iyz="0"/>'
IMPOSSIBLE = {
    "all zero": '<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>',
    "negative": '<inertia ixx="0.01" iyy="-0.01" izz="0.004" ixy="0" ixz="0" iyz="0"/>',
    "triangle": '<inertia ixx="0.01" iyy="0.01" izz="0.1" ixy="0" ixz="0" iyz="0"/>',
}


def saved(log: Log, folder: Path, old: str, new: str) -> Path:
    """The log's folder with another nominal model."""
    path = save_log(log, folder / "log")
    assert old in ARM
    (path / "robot.urdf").write_text(ARM.replace(old, new))
    return path


@pytest.mark.parametrize("kind", IMPOSSIBLE)
def test_an_impossible_inertia_is_a_starting_value_and_is_said(
    kind: str, arm_log: Log, tmp_path: Path
) -> None:
    path = saved(arm_log, tmp_path, FORE, IMPOSSIBLE[kind])
    robot = nominal_robot(load_log(path))
    (finding,) = nominal_faults(robot)
    assert finding.places == ("fore",)
    assert "starting value" in finding.text
    assert "fore" in finding.text
    # What the file says of masses is kept.
    np.testing.assert_allclose(robot.nominal_parameters[::10], [2.0, 1.0])
    assert nominal_faults(robot_for_log(path / "robot.urdf", path)) == (finding,)


def test_a_sound_model_says_nothing(arm_log: Log, tmp_path: Path) -> None:
    robot = nominal_robot(load_log(save_log(arm_log, tmp_path / "log")))
    assert nominal_faults(robot) == ()


def test_what_is_at_rest_may_be_impossible(arm_log: Log, tmp_path: Path) -> None:
    base = f'<link name="base"><inertial><mass value="4"/>{IMPOSSIBLE["triangle"]}</inertial></link>'
    path = saved(arm_log, tmp_path, '<link name="base"/>', base)
    assert nominal_faults(nominal_robot(load_log(path))) == ()


@pytest.mark.parametrize("mass", ["-1", "nan", "1,5"])
def test_no_number_and_no_mass_are_refused(mass: str, arm_log: Log, tmp_path: Path) -> None:
    path = saved(arm_log, tmp_path, '<mass value="1"/>', f'<mass value="{mass}"/>')
    with pytest.raises(RobotError, match="fore"):
        nominal_robot(load_log(path))


@pytest.mark.parametrize("stated", [True, False])
def test_balls_of_feet_are_where_they_are_though_a_log_has_no_posture_at_rest(
    stated: bool, tmp_path: Path
) -> None:
    """A Go2's shanks lean at rest; its feet are meshes, about the origins of their links."""
    go2 = load_robot("go2")
    header = log_header(go2, (TrialHeader(file="one.parquet", role="identification"),))
    assert header.feet[0].centre is not None
    if not stated:
        feet = tuple(foot.model_copy(update={"centre": None}) for foot in header.feet)
        header = header.model_copy(update={"feet": feet})
    file = tmp_path / "robot.urdf"
    file.write_text(go2.urdf, encoding="utf-8")
    bare = build_robot(bare_description(file, header), file)
    for known, foot in zip(go2.feet, bare.feet, strict=True):
        np.testing.assert_allclose(foot.centre, known.centre, atol=1e-5)


# Several logs as one.


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
    return [found.kind for found in examine(robot, log).findings if found.kind in {"rate", "low_rate"}]


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
