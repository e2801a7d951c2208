"""The nominal model that a log names: what no body has is said, what is at rest does not matter."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from excite.errors import RobotError
from excite.logs.bare_urdf import nominal_faults
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot, robot_for_log
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
