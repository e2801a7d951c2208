"""A package of MoveIt in one argument: the model that it names, its pairs that may touch, its limits."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import excite
from excite.errors import RobotError

pytestmark = pytest.mark.usefixtures("readers_here")

BODY = (
    '<link name="{0}"><inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>'
    '</inertial><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>'
)
JOINT = (
    '<joint name="{0}" type="revolute"><origin xyz="0 0 0.3"/><axis xyz="0 1 0"/><parent link="{1}"/>'
    '<child link="{2}"/>'
    '<limit lower="-2" upper="2" effort="40" velocity="3"/></joint>'
)
ARM = (
    '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    + "".join(map(BODY.format, ("base", "upper", "fore")))
    + JOINT.format("shoulder", "base", "upper")
    + JOINT.format("elbow", "upper", "fore")
    + "</robot>"
)
SRDF = '<robot name="arm"><disable_collisions link1="base" link2="fore" reason="Never"/></robot>'
LIMITS = "joint_limits:\n  elbow: {has_velocity_limits: true, max_velocity: 1.5}\n"
NOTED = "moveit_setup_assistant_config:\n  {0}: {{package: arm_description, relative_path: urdf/arm.urdf.xacro}}\n"


@pytest.fixture
def package(tmp_path: Path) -> Callable[[str], Path]:
    """A workspace with a description and a configuration; the latter, with what its assistant noted."""

    def write(noted: str) -> Path:
        config = tmp_path / "src" / "arm_moveit_config"
        for file, text in {
            tmp_path
            / "src"
            / "arm_description_ros"
            / "package.xml": "<package><name>arm_description</name></package>",
            tmp_path / "src" / "arm_description_ros" / "urdf" / "arm.urdf.xacro": ARM,
            config / "package.xml": "<package><name>arm_moveit_config</name></package>",
            config / "config" / "arm.srdf": SRDF,
            config / "config" / "joint_limits.yaml": LIMITS,
            **({config / ".setup_assistant": noted} if noted else {}),
        }.items():
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
        return config

    return write


@pytest.mark.parametrize("word", ["urdf", "URDF"])
def test_one_argument_brings_model_pairs_and_limits(word: str, package: Callable[[str], Path]) -> None:
    folder = package(NOTED.format(word))
    robot = excite.load_robot(folder)
    assert robot.joint_names == ("shoulder", "elbow")
    np.testing.assert_allclose(robot.limits.velocity, [3.0, 1.5])
    assert ("base", "fore") in {tuple(pair) for pair in robot.description.collision.ignored_pairs}
    assert excite.robots.examine_description(folder).robot == "arm.urdf"
    # Described once, the folder is the robot.
    written = excite.write_scaffold(folder, folder).description
    np.testing.assert_allclose(excite.load_robot(written.parent).limits.velocity, robot.limits.velocity)


def test_limits_of_a_joint_that_is_not_there_are_said_to_be_of_no_use(package: Callable[[str], Path]) -> None:
    folder = package(NOTED.format("urdf"))
    limits = folder / "config" / "joint_limits.yaml"
    limits.write_text(LIMITS + "  knee: {has_velocity_limits: true, max_velocity: 0.5}\n")
    (said,) = [
        one for one in excite.load_robot(folder).description.assumed if "joint_limits.yaml" in one.what
    ]
    assert "velocity of elbow" in said.value and "is called so, of knee" in said.value


def test_links_of_an_srdf_that_the_model_does_not_have_are_said(package: Callable[[str], Path]) -> None:
    folder = package(NOTED.format("urdf"))
    assert not [
        one for one in excite.load_robot(folder).description.assumed if "not in the model" in one.what
    ]
    (folder / "config" / "arm.srdf").write_text(SRDF.replace("fore", "fore_arm"))
    (said,) = [one for one in excite.load_robot(folder).description.assumed if "not in the model" in one.what]
    assert said.value == "fore_arm"


def test_a_model_that_is_not_there_is_one_line(package: Callable[[str], Path]) -> None:
    with pytest.raises(RobotError, match=r"holds no|is a folder without a robot\.yaml or a model"):
        excite.load_robot(package(""))
    with pytest.raises(RobotError, match=r"'other_description', which is not found.*--package-path"):
        excite.load_robot(package(NOTED.format("urdf").replace("arm_description", "other_description")))


def test_a_description_alone_is_taken_where_it_holds_one_model(package: Callable[[str], Path]) -> None:
    folder = package("").parent / "arm_description_ros"
    assert excite.load_robot(folder).joint_names == ("shoulder", "elbow")
    (folder / "urdf" / "other.urdf.xacro").write_text(ARM)
    with pytest.raises(RobotError, match=r"holds 2 models .*name one of them"):
        excite.load_robot(folder)
