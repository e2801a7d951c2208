"""Legs and upper body are found wherever the base link is."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from excite.motion.generators.generator import (
    free_upper_body,
    leg_joints,
    pelvis_height,
    pelvis_joint,
    upper_body,
)
from excite.robot.loading import load_robot


@pytest.mark.parametrize(
    ("name", "pelvis", "joints_of_a_leg", "upper"),
    [("hrp2like", "chest_yaw_link", 6, 18), ("talos", "base_link", 6, 18)],
)
def test_the_pelvis_is_where_the_legs_part(name: str, pelvis: str, joints_of_a_leg: int, upper: int) -> None:
    robot = load_robot(name)
    assert robot.segments[pelvis_joint(robot) - 1].link == pelvis
    legs = [leg_joints(robot, foot) for foot in robot.feet]
    assert all(len(leg) == joints_of_a_leg for leg in legs)
    assert all("leg" in robot.joint_names[i] for leg in legs for i in leg)
    assert not set(legs[0]) & set(legs[1])
    assert upper_body(robot).sum() == upper
    hips = 0.5 * robot.rest[2] if name == "talos" else 0.6
    assert hips < pelvis_height(robot) <= robot.rest[2]


def test_the_waist_of_a_robot_with_its_base_in_the_trunk_is_upper_body() -> None:
    robot = load_robot("hrp2like")
    moving = np.array(robot.joint_names)[upper_body(robot)]
    assert {"chest_pitch", "chest_yaw", "head_yaw", "rarm_wrist_roll"} <= set(moving)


@pytest.mark.parametrize("name", ["g1", "talos", "hrp2like"])
def test_free_upper_body_leaves_the_feet_where_they_are(name: str) -> None:
    robot = load_robot(name)
    free = free_upper_body(robot)
    assert 14 <= free.sum() < robot.n_joints
    data, q = robot.model.createData(), robot.rest.copy()

    def soles() -> np.ndarray:
        pin.forwardKinematics(robot.model, data, q)
        return np.array([(data.oMi[foot.joint] * foot.placement).homogeneous for foot in robot.feet])

    before = soles()
    q[robot.n_base_q :][free] += 0.3
    assert np.abs(soles() - before).max() < 1e-12
