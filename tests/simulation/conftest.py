"""Virtual robots and runs shared by the tests of this folder."""

from __future__ import annotations

from dataclasses import replace

import pytest

from excite.robot.robot import Robot
from excite.simulation.execution import execute_motion
from excite.simulation.virtual_robot import Recording, VirtualRobot, changed_robot
from tests.simulation.motions import generator, squatting, waving


@pytest.fixture(scope="session")
def changed_g1(g1: Robot) -> VirtualRobot:
    return replace(changed_robot(g1, generator(3)), noise=0.0)


@pytest.fixture(scope="session")
def squat(changed_g1: VirtualRobot) -> Recording:
    return execute_motion(changed_g1, squatting(changed_g1.robot, duration=2.0))


@pytest.fixture(scope="session", params=["panda", "ur10"])
def arm(request: pytest.FixtureRequest) -> VirtualRobot:
    return replace(changed_robot(request.getfixturevalue(request.param), generator(5)), noise=0.0)


@pytest.fixture(scope="session")
def arm_run(arm: VirtualRobot) -> Recording:
    joints = dict.fromkeys(arm.robot.joint_names, 0.4)
    return execute_motion(arm, waving(arm.robot, joints, duration=2.0))
