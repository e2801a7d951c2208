"""Robots and good motions that the tests of the checks start from."""

from __future__ import annotations

import pytest

from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from tests.safety.motions import arm_motion, squat


@pytest.fixture(scope="session")
def humanoid(g1: Robot) -> Robot:
    """The bundled G1."""
    return g1


@pytest.fixture(scope="session")
def arm() -> Robot:
    """The bundled UR10."""
    return load_robot("ur10")


@pytest.fixture(scope="session")
def squatting(humanoid: Robot) -> Motion:
    """A squat with both soles where they are at rest."""
    return squat(humanoid)


@pytest.fixture(scope="session")
def swinging(arm: Robot) -> Motion:
    """Every joint of the arm swings about its rest posture."""
    return arm_motion(arm)
