"""The arm that logs are of, and a sound log of it."""

from __future__ import annotations

import pytest

from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log


@pytest.fixture(scope="session")
def panda():
    return load_robot("panda")


@pytest.fixture(scope="session")
def log(panda):
    return arm_log(panda)
