"""The arm that recordings are of, and its motion."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from excite.conversion import convert
from tests.conversion import written


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    return written.arm_urdf(tmp_path / "arm.urdf")


@pytest.fixture
def data() -> dict[str, np.ndarray]:
    return written.motion()


@pytest.fixture(scope="module")
def unexamined() -> Iterator[None]:
    """The doctor does not look at what was converted: for tests of what columns are taken for, which come before."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(convert, "_examine_log", lambda *_: (None, []))
        yield
