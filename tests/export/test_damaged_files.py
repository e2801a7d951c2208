"""Files that export wrote and that were damaged since: read, or refused in one line, never a crash."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from excite.errors import ExciteError
from excite.export.export import export_motion
from excite.export.exporter import motion_rows
from excite.export.registry import EXPORTERS
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from tests.export.conftest import ready

# In this process, of text or Parquet; bags and YAML are read in one of their own, and have tests of their own.
ROBOT = "panda"
HERE = ("ur-script", "mujoco-keyframes", "lerobot", "franka", "unitree", "openhrp")


@pytest.fixture(scope="module")
def short() -> Motion:
    """A tenth of a second, which is cut off moving."""
    return motion_rows(ready("panda")[1], slice(8))


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """Some bytes changed, a piece cut out, or a piece twice."""
    data = bytearray(content)
    kind, at = rng.integers(4), int(rng.integers(len(data)))
    if kind == 0:
        for place in rng.integers(len(data), size=4):
            data[place] = int(rng.integers(256))
    elif kind == 1:
        del data[at : at + int(rng.integers(1, 200))]
    elif kind == 2:
        data[at:at] = data[at : at + int(rng.integers(1, 200))]
    else:
        words = [b"nan", b"1e999", b"{}", b"[", b'"', b"<", b"-", b"null", b"\n"]
        data[at:at] = words[int(rng.integers(len(words)))]
    return bytes(data)


@pytest.mark.parametrize("format", HERE)
def test_a_damaged_file_is_read_or_refused_in_one_line(
    format: str, arm: Robot, short: Motion, tmp_path: Path
) -> None:
    settings = {"unitree": {"motors": "model", "kp": 60, "kd": 2}}.get(format)
    robot, motion = arm, short
    if format == "ur-script":
        robot, motion = ready("ur10")
        motion = motion_rows(motion, slice(8))
    whole = export_motion(
        motion, robot, format, tmp_path / "whole", settings=settings, unsafe_anyway="damage"
    )
    assert load_motion(whole, robot).n_samples >= 8
    rng = np.random.default_rng(sorted(EXPORTERS).index(format))
    for number in range(60):
        copy = tmp_path / f"{number}{whole.suffix}"
        (shutil.copytree if whole.is_dir() else shutil.copy)(whole, copy)
        files = sorted(file for file in copy.rglob("*") if file.is_file()) if copy.is_dir() else [copy]
        file = files[int(rng.integers(len(files)))]
        file.write_bytes(damaged(file.read_bytes(), rng))
        try:
            load_motion(copy, robot)
        except ExciteError as error:
            assert "\n" not in str(error) and str(copy) in str(error), error
