"""FollowJointTrajectory goals, read back by PyYAML as `ros2 action send_goal` does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from excite.errors import MotionError
from excite.export.export import export_motion
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.repairs.sampling import plan_transfer
from tests.safety.motions import check_file

pytestmark = pytest.mark.usefixtures("readers_here")

ROBOT = "panda"


@pytest.fixture(scope="module")
def goal(arm: Robot, motion: Motion, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export_motion(motion, arm, "ros2-yaml", tmp_path_factory.mktemp("goal") / "first")


def test_the_goal_has_the_messages_fields_and_every_digit(goal: Path, motion: Motion) -> None:
    content = yaml.safe_load(goal.read_text())
    assert list(content) == ["trajectory"] and set(content["trajectory"]) == {"joint_names", "points"}
    assert content["trajectory"]["joint_names"] == list(motion.joint_names)
    points = content["trajectory"]["points"]
    for field, values in (
        ("positions", motion.q),
        ("velocities", motion.v),
        ("accelerations", motion.a),
    ):
        # Numbers such as 1e-05 would be words in YAML 1.1.
        assert all(isinstance(value, float) for point in points for value in point[field])
        np.testing.assert_array_equal([point[field] for point in points], values)
    stamps = [point["time_from_start"] for point in points]
    assert all(type(stamp[name]) is int and 0 <= stamp[name] for stamp in stamps for name in stamp)
    times = [stamp["sec"] * 10**9 + stamp["nanosec"] for stamp in stamps]
    assert times == [round((t - motion.time[0]) * 1e9) for t in motion.time]


def test_tiny_numbers_stay_numbers(arm: Robot, motion: Motion, tmp_path: Path) -> None:
    v = motion.v.copy()
    v[0, :3] = 1e-05, -3e-07, 1.5e-09
    path = export_motion(replace(motion, v=v), arm, "ros2-yaml", tmp_path / "tiny")
    first = yaml.safe_load(path.read_text())["trajectory"]["points"][0]
    assert first["velocities"] == list(v[0])


def test_the_command_that_sends_it_fits_an_argument_or_reads_a_file(
    goal: Path, arm: Robot, motion: Motion, tmp_path: Path
) -> None:
    action = "/joint_trajectory_controller/follow_joint_trajectory"
    start = f"# ros2 action send_goal {action} control_msgs/action/FollowJointTrajectory "
    command = goal.read_text().splitlines()[0]
    assert goal.stat().st_size < 131_072 and command == f'{start}"$(cat first.yaml)"'
    path = export_motion(
        motion, arm, "ros2-yaml", tmp_path / "long", 500.0, settings={"controller": "/left/arm"}
    )
    assert path.stat().st_size > 131_072
    assert path.read_text().startswith(
        "# ros2 action send_goal /left/arm/follow_joint_trajectory control_msgs/action/FollowJointTrajectory"
        " --stdin < long.yaml"
    )


GOAL = """trajectory:
  joint_names: [{names}]
  points:
  - {{positions: [0, 0, 0, -1.5, 0, 1.5, 0], time_from_start: {{sec: 0, nanosec: 0}}}}
  - {{positions: {second}, time_from_start: {time}}}
"""
NAMES = ", ".join(f"panda_joint{k}" for k in range(1, 8))


@pytest.mark.parametrize(
    ("second", "time", "said"),
    [
        ("[0, 0, 0]", "{sec: 1}", "point 1 has 3 positions for 7 names"),
        (
            "[1e-3, 0, 0, 0, 0, 0, 0]",
            "{sec: 1}",
            "points.1.positions.0: is '1e-3', not a number.*before the exponent",
        ),
        ("[0, 0, 0, 0, 0, 0, 0]", "1.5", "points.1.time_from_start: is 1.5, not an object"),
        ("[0, 0, 0, 0, 0, 0, .nan]", "{sec: 1}", r"points.1.positions.6: is \.nan"),
    ],
)
def test_a_goal_made_elsewhere_that_is_none_is_one_line(
    second: str, time: str, said: str, arm: Robot, tmp_path: Path
) -> None:
    path = tmp_path / "goal.yaml"
    path.write_text(GOAL.format(names=NAMES, second=second, time=time))
    with pytest.raises(MotionError, match=said):
        load_motion(path, arm)


def test_other_yaml_is_no_motion(arm: Robot) -> None:
    with pytest.raises(MotionError, match=r"unknown format '\.yaml'"):
        load_motion(arm.source, arm)


def test_several_goals_end_where_the_joints_stand_still_and_are_one_motion(tmp_path: Path) -> None:
    robot = load_robot("ur10")
    start = robot.rest + 0.3
    part = plan_transfer(robot, start, start + 0.2, 125.0)
    away = Motion("away", robot.name, robot.joint_names, part.time, part.q, part.v, part.a)
    path = export_motion(
        away, robot, "ros2-yaml", tmp_path / "away", approach=True, settings={"segments": "rests"}
    )
    goals = sorted(path.iterdir())
    assert [goal.name for goal in goals] == ["goal_000.yaml", "goal_001.yaml", "goal_002.yaml"]
    ends = []
    for goal in goals:
        points = yaml.safe_load(goal.read_text())["trajectory"]["points"]
        assert points[0]["time_from_start"] == {"sec": 0, "nanosec": 0}
        assert not any(points[-1]["velocities"])
        ends += [points[0]["positions"], points[-1]["positions"]]
    np.testing.assert_array_equal(ends[1::2][:-1], ends[2::2])
    np.testing.assert_allclose(
        [ends[0], ends[2], ends[3], ends[5]], [robot.rest, start, start + 0.2, robot.rest]
    )
    one = export_motion(away, robot, "ros2-yaml", tmp_path / "one", approach=True)
    again, whole = load_motion(path, robot), load_motion(one, robot)
    np.testing.assert_allclose(again.time, whole.time, atol=2e-9)
    np.testing.assert_array_equal(again.q, whole.q)
    assert check_file(robot, path).safe


def test_a_goal_ends_with_the_zero_velocity_that_controllers_ask_for(
    arm: Robot, motion: Motion, tmp_path: Path
) -> None:
    v = motion.v.copy()
    v[-1] = 1e-4
    path = export_motion(replace(motion, v=v), arm, "ros2-yaml", tmp_path / "nearly")
    points = yaml.safe_load(path.read_text())["trajectory"]["points"]
    assert points[-1]["velocities"] == [0.0] * 7 and points[-2]["velocities"] == list(v[-2])
