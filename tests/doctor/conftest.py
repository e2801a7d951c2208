"""The arm that logs are of, and a sound log of it."""

from __future__ import annotations

import pytest

from tests.identification.practice_log import arm_log


@pytest.fixture(scope="session")
def log(panda):
    return arm_log(panda)
