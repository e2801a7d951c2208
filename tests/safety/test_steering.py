"""Legs with fewer joints than a foot has coordinates still squat."""

from __future__ import annotations

import re

import numpy as np
import pytest

from excite.motion.generators.registry import make_generator
from excite.robot.init_robot.files import write_scaffold
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.filter import filter_candidate
from excite.safety.repairs.whole_body import find_steering

ALL = {"x", "y", "height", "roll", "pitch", "yaw"}


@pytest.fixture(scope="module")
def stiff_ankles(humanoid: Robot, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """The G1 with ankles that only pitch, as the H1 has them."""
    text = re.sub(
        r'(<joint name="(?:left|right)_ankle_roll_joint" type=)"revolute"', r'\1"fixed"', humanoid.urdf
    )
    folder = tmp_path_factory.mktemp("stiff")
    (folder / "stiff.urdf").write_text(text, encoding="utf-8")
    return load_robot(write_scaffold(folder / "stiff.urdf", folder).description)


def test_legs_of_six_joints_and_points_on_three_steer_everything(humanoid: Robot) -> None:
    assert find_steering(humanoid).trunk == ALL
    assert all(len(held) == 6 for held in find_steering(humanoid).soles.values())
    assert find_steering(load_robot("go2")).trunk == ALL


def test_legs_of_five_joints_steer_the_centre_of_mass_first(stiff_ankles: Robot) -> None:
    found = find_steering(stiff_ankles)
    assert {"x", "y", "height"} < found.trunk
    # On parallel feet one coordinate of the second follows from those of the first.
    assert sorted(len(held) for held in found.soles.values()) == [5, 6]
    assert len(found.trunk) + 11 == 6 + 10


def test_a_robot_whose_ankles_do_not_roll_squats(stiff_ankles: Robot) -> None:
    candidates = make_generator("squat").candidates(stiff_ankles, 6, np.random.SeedSequence(5))
    assert any(filter_candidate(stiff_ankles, candidate).motion is not None for candidate in candidates)
