"""The arm that recordings are of, and its motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.conversion import written


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    return written.arm_urdf(tmp_path / "arm.urdf")


@pytest.fixture
def data() -> dict[str, np.ndarray]:
    return written.motion()
