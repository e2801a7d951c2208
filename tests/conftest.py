"""Fixtures shared by all tests."""

from __future__ import annotations

import gc
import os
from pathlib import Path
from typing import NoReturn

import pytest

from excite.robot.loading import load_robot
from excite.robot.robot import Robot


def lacking(reason: str) -> NoReturn:
    """Skip a test whose recordings are not here; in CI, where they have to be, it fails."""
    if os.environ.get("CI") == "true":
        pytest.fail(reason)
    pytest.skip(reason)


# All modules and 7,450 tests are gathered before the first test runs, and nothing of that is garbage: looking for some
# takes 9 s of 21.
gc.disable()


def pytest_collection_finish(session: pytest.Session) -> None:
    """What is loaded now stays: the garbage collector need not look through all of it again and again."""
    gc.collect()
    gc.freeze()
    # As the program has it.
    gc.set_threshold(50_000, 20, 20)
    gc.enable()


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder with public recordings of real robots: ``$EXCITE_DATA``, else ``../shared/data``."""
    folder = Path(os.environ.get("EXCITE_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    if not folder.is_dir():
        reason = f"recordings not found in {folder}; set EXCITE_DATA to the folder that holds them"
        lacking(reason)
    return folder


@pytest.fixture(scope="session")
def gap_dir() -> Path:
    """Folder with practice cases of the diagnosis: ``gap`` beside the recordings."""
    data = Path(os.environ.get("EXCITE_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    folder = data.parent / "gap"
    if not folder.is_dir():
        reason = f"practice cases not found in {folder}; put them beside the recordings (EXCITE_DATA)"
        lacking(reason)
    return folder


@pytest.fixture(scope="session")
def g1() -> Robot:
    """The bundled Unitree G1."""
    return load_robot("g1")


@pytest.fixture(scope="session")
def ur10() -> Robot:
    """The bundled UR10."""
    return load_robot("ur10")


@pytest.fixture(scope="session")
def panda() -> Robot:
    """The bundled Panda."""
    return load_robot("panda")
