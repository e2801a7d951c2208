"""A first description: what it derives is right, what it leaves open is named, and filled in it loads."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import RobotError
from excite.robot.catalogue import example_robot_data
from excite.robot.loading import load_robot
from excite.robot.scaffold.description import scaffold_description
from excite.robot.shapes.collision import collision_model
from tests.robot.small import ARM

ANSWERS = {
    "source": "by hand",
    "rate_hz": 100.0,
    "noise_position": 1e-4,
    "joint_torque": "link_side",
    "default": 0.1,
    "friction": 0.6,
    "noise_force": 1.0,
    "noise_moment": 0.1,
    "noise_base_position": 1e-3,
    "noise_base_orientation": 1e-3,
}
"""What a person says, by field; anything else gets ``otherwise``."""


def fill_in(text: str, otherwise: object = None) -> str:
    """Replace each ``null`` of a scaffold by an answer."""

    def answer(match: re.Match[str]) -> str:
        value = ANSWERS.get(match["key"], otherwise)
        return match["head"] + json.dumps(value)

    return re.sub(r"^(?P<head>\s*(?P<key>[\w.]+): )null", answer, text, flags=re.MULTILINE)


def wheel(name: str, folder: Path) -> Path:
    """A robot of the data wheel as somebody's own file, meshes found by absolute path."""
    urdf = example_robot_data() / name
    text = urdf.read_text(encoding="utf-8")
    text = re.sub("package:///?example-robot-data", str(example_robot_data().parent), text)
    path = folder / "mine.urdf"
    path.write_text(text, encoding="utf-8")
    return path


def scaffold(path: Path, otherwise: object = None) -> Path:
    target = path.with_name("robot.yaml")
    target.write_text(fill_in(scaffold_description(path), otherwise), encoding="utf-8")
    return target


def test_open_fields_are_named_one_after_the_other(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    text = scaffold_description(path)
    target = tmp_path / "robot.yaml"
    named = []
    for _ in range(20):
        target.write_text(text)
        try:
            load_robot(target)
        except RobotError as error:
            field = str(error.field or error.what)
            named.append(next(key for key in ANSWERS if key in field.split(".")[-1] or f".{key}:" in field))
            text = re.sub(rf"({named[-1]}: )null", rf"\g<1>{ANSWERS[named[-1]]}", text, count=1)
        else:
            break
    assert ": null" not in text
    assert set(named) == {"source", "rate_hz", "noise_position", "joint_torque", "default"}


def test_small_arm(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    robot = load_robot(scaffold(path))
    assert (robot.name, robot.floating, robot.joint_names) == ("arm", False, ("shoulder", "elbow"))
    np.testing.assert_allclose(robot.limits.velocity, [2.0, 3.0])
    np.testing.assert_allclose(robot.limits.torque, [50.0, 20.0])
    # 30 % of 20 N·m on the forearm's inertia about the elbow, 0.01 + 1 kg · (0.15 m)².
    assert robot.limits.acceleration[1] == pytest.approx(min(30.0, 0.3 * 20.0 / 0.0325), rel=0.05)
    assert len(collision_model(robot).collisionPairs) == 0


@pytest.mark.parametrize("name", ["ur_description/urdf/ur5_robot.urdf", "xarm_description/urdf/xarm7.urdf"])
def test_arm_of_the_wheel_as_ones_own(name: str, tmp_path: Path) -> None:
    path = wheel(name, tmp_path)
    robot = load_robot(scaffold(path))
    assert not robot.floating
    reference = pin.buildModelFromUrdf(str(example_robot_data() / name))
    assert robot.joint_names == tuple(reference.names)[1:]
    assert robot.mass == pytest.approx(pin.computeTotalMass(reference))
    assert collision_model(robot).collisionPairs


def test_humanoid_with_mimic_joints(tmp_path: Path) -> None:
    """TALOS with moving fingers: base, feet, sole, mirror pairs and held grippers are found."""
    robot = load_robot(scaffold(wheel("talos_data/robots/talos_full_v2.urdf", tmp_path)))
    assert robot.floating
    assert robot.n_joints == 30
    assert robot.mass == pytest.approx(93.3357, abs=1e-3)
    assert set(robot.description.locked_joints) == {"gripper_left_joint", "gripper_right_joint"}
    assert {foot.link for foot in robot.feet} == {"leg_left_6_link", "leg_right_6_link"}
    size = np.ptp(robot.foot("leg_left_6_link").sole, axis=0)
    np.testing.assert_allclose(size[:2], [0.21, 0.124], atol=0.03)
    assert sum(segment.pair is not None for segment in robot.segments) == 26


def test_continuous_joints_and_faulty_links_are_left_to_the_person(tmp_path: Path) -> None:
    text = ARM.replace('<joint name="elbow" type="revolute">', '<joint name="elbow" type="continuous">')
    text = text.replace('izz="0.004"', 'izz="0.4"')
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    draft = scaffold_description(path)
    assert re.search(r"^ +elbow: null  # FILL IN: turns without end", draft, re.MULTILINE)
    assert re.search(r"^ +upper: null  # breaks the triangle inequality", draft, re.MULTILINE)
    draft = draft.replace("elbow: null", "elbow: [-3.0, 3.0]").replace("upper: null", "upper: a brass block")
    target = tmp_path / "robot.yaml"
    target.write_text(fill_in(draft))
    assert load_robot(target).limits.position_upper[1] == pytest.approx(3.0 - 0.03)


def test_missing_torque_and_velocity_limits_are_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM.replace(' velocity="3.0" effort="20"', ""))
    text = scaffold_description(path)
    assert text.count("    joints:\n      elbow: null  # FILL IN") == 2
    target = tmp_path / "robot.yaml"
    target.write_text(fill_in(text, otherwise=4.0))
    np.testing.assert_allclose(load_robot(target).limits.torque, [50.0, 4.0])


def test_arm_without_geometry_asks_for_shapes(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(re.sub(r"<collision>.*?</collision>", "", ARM, flags=re.DOTALL))
    text = scaffold_description(path)
    assert "shapes: null  # FILL IN" in text
    target = tmp_path / "robot.yaml"
    shapes = [{"link": "lower", "kind": "sphere", "size": [0.1]}]
    target.write_text(fill_in(text, otherwise=shapes))
    assert len(collision_model(load_robot(target)).geometryObjects) == 1


def test_path_is_relative_to_the_folder_it_is_written_to(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    folder = tmp_path / "robots" / "arm"
    folder.mkdir(parents=True)
    (folder / "robot.yaml").write_text(fill_in(scaffold_description(path, folder)))
    assert load_robot(folder).n_joints == 2


def test_same_seed_same_text(tmp_path: Path) -> None:
    path = wheel("ur_description/urdf/ur5_robot.urdf", tmp_path)
    assert scaffold_description(path) == scaffold_description(path)


@pytest.mark.parametrize(
    ("text", "message"), [("<mujoco/>", "export it as URDF"), ("<robot name='x'/>", "no <link>")]
)
def test_what_cannot_be_described_is_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(text)
    with pytest.raises(RobotError, match=message):
        scaffold_description(path)
