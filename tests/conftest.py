"""Fixtures shared by all tests."""

from __future__ import annotations

import gc
import importlib
import os
import pickle
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, NoReturn

import pytest

from excite.cli.main import _run_command
from excite.errors import ExciteError
from excite.formats import child
from excite.parallel import engine
from excite.robot.loading import load_robot
from excite.robot.robot import Robot


def lacking(reason: str) -> NoReturn:
    """Skip a test whose recordings are not here; in CI, where they have to be, it fails."""
    if os.environ.get("CI") == "true":
        pytest.fail(reason)
    pytest.skip(reason)


# All modules and 7,150 tests are gathered before the first test runs, and nothing of that is garbage: looking for some
# takes 9 s of 21.
gc.disable()


def pytest_collection_finish(session: pytest.Session) -> None:
    """What is loaded now stays: the garbage collector need not look through all of it again and again."""
    gc.collect()
    gc.freeze()
    # As the program has it.
    gc.set_threshold(50_000, 20, 20)
    gc.enable()


@contextmanager
def reading_here() -> Iterator[None]:
    """Native readers read in this process."""

    def answer(file: IO[bytes], *_: object) -> int:
        file.seek(0)
        function, args, _memory_gb = pickle.load(file)  # noqa: S301  (from our own code)
        module, _, name = function.partition(":")
        try:
            made = "returned", getattr(importlib.import_module(module), name)(*args)
        except ExciteError as error:
            made = "raised", error
        except Exception:  # noqa: BLE001  (a child would end with it)
            return 1
        pickle.dump(made, file)
        return 0

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(child, "_run_task", answer)
        yield


@pytest.fixture(scope="module")
def readers_here() -> Iterator[None]:
    """Native readers read in this process: for tests of what whole files say, not of those that make readers crash.

    To start a process takes longer than to read most of the files that tests write.
    """
    with reading_here():
        yield


@pytest.fixture
def reader_here() -> Iterator[None]:
    """The same for one test of a module whose others make readers crash."""
    with reading_here():
        yield


@pytest.fixture(scope="session", autouse=True)
def one_process() -> Iterator[None]:
    """Commands that tests run in their own process do all work in it, where nobody says how many shall.

    Results are the same, and other processes load all libraries again.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine, "_START_S", float("inf"))
        yield


@pytest.fixture
def excite_here(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Runs a command in this process, which has loaded what every command would load for itself."""

    def run(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
        monkeypatch.chdir(cwd)
        words = [*map(str, arguments)]
        code = _run_command(words)
        said = capfd.readouterr()
        return subprocess.CompletedProcess(words, code, said.out, said.err)

    return run


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
