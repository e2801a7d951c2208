"""The ground of a fixed base is never absent: what is not stated is its mounting plane."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

from excite.motion.motion import Motion, MotionMetadata
from excite.robot.catalogue import example_robot_data
from excite.robot.init_robot.files import write_scaffold
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.robot.shapes.collision import TABLE, collision_shapes
from excite.robot.shapes.shape import bottom_points
from excite.safety.check import check_motion
from tests.robot.test_scaffold import biped


@pytest.fixture(scope="module")
def described(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """First description of a UR5."""
    folder = tmp_path_factory.mktemp("ur5")
    urdf = example_robot_data() / "ur_description/urdf/ur5_robot.urdf"
    return write_scaffold(urdf, folder, absolute=True).description


def edited(described: Path, **collision: object) -> Robot:
    """The robot without its table's height, or with another one."""
    content = yaml.safe_load(described.read_text())
    del content["collision"]["table_height"]
    content["collision"].update(collision)
    content["assumed"] = []
    path = described.with_name(f"edited{len(collision)}.yaml")
    path.write_text(yaml.safe_dump(content))
    return load_robot(path)


def reaching_down(robot: Robot) -> Motion:
    """From rest to where the stretched arm points half a radian below level, and back, slowly."""
    low = robot.rest.copy()
    low[:] = 0.0
    low[robot.joint_names.index("shoulder_lift_joint")] = 0.5
    time = np.arange(0.0, 20.0, 0.01)
    share = 0.5 - 0.5 * np.cos(2.0 * np.pi * time / time[-1])
    rate = np.gradient(share, time)
    way = low - robot.rest
    q = robot.rest + share[:, None] * way
    return Motion(
        name="down",
        robot=robot.name,
        joint_names=robot.joint_names,
        time=time,
        q=q,
        v=rate[:, None] * way,
        a=np.gradient(rate, time)[:, None] * way,
        contacts={},
        metadata=MotionMetadata(generator="", seed=0, targets=(), robot_hash=robot.hash, versions={}),
    )


def touches_ground(robot: Robot, motion: Motion) -> bool:
    """Whether the check says that a link comes too near to the ground."""
    return any(
        item.kind == "self_collision" and TABLE in item.where
        for item in check_motion(robot, motion).violations
    )


def test_a_tool_below_the_mounting_plane_is_refused_without_a_stated_table(described: Path) -> None:
    robot = edited(described)
    motion = reaching_down(robot)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, motion.q[len(motion.q) // 2])
    assert data.oMi[robot.model.njoints - 1].translation[2] < -0.15
    assert touches_ground(robot, motion)
    assert any(one.what == "ground" for one in robot.description.assumed)
    assert check_motion(robot, motion).safe is False


def test_who_says_that_nothing_is_there_is_believed(described: Path) -> None:
    robot = edited(described, table_height=None)
    assert not touches_ground(robot, reaching_down(robot))
    assert not any(shape.link == TABLE for shape in collision_shapes(robot))
    assert not any(one.what == "ground" for one in robot.description.assumed)


def test_with_and_without_ground_are_two_robots(described: Path) -> None:
    """What was checked for the one is not taken for checked for the other."""
    assert edited(described).hash != edited(described, table_height=None).hash


def test_what_is_held_up_reaches_no_ground(tmp_path: Path) -> None:
    """A biped without a word on its soles' shape: its legs swing free, whatever their joints do."""
    path = tmp_path / "two.urdf"
    path.write_text(re.sub(r"<collision>.*?</collision>", "", biped()))
    robot = load_robot(write_scaffold(path, tmp_path / "held").description)
    assert robot.description.base == "held" and not robot.feet
    said = " ".join(str(one) for one in robot.description.assumed)
    assert "where its soles are" in said and "hold the robot so high" in said
    ground = robot.description.collision.table_height
    data, rng = robot.model.createData(), np.random.default_rng(3)
    lowest = np.inf
    for _ in range(200):
        q = rng.uniform(robot.limits.position_lower, robot.limits.position_upper)
        pin.forwardKinematics(robot.model, data, q)
        own = [shape for shape in collision_shapes(robot) if shape.link != TABLE and shape.joint]
        lowest = min(lowest, *(bottom_points(shape, data.oMi[shape.joint])[:, 2].min() for shape in own))
    assert ground is not None and lowest - 0.5 < ground < lowest - 0.1
