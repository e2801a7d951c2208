"""The arm that recordings are of, and its motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.conversion import written


@pytest.fixture(scope="session")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written.arm_urdf(tmp_path_factory.mktemp("arm") / "arm.urdf")


@pytest.fixture
def data() -> dict[str, np.ndarray]:
    return written.motion()
