"""Temporary folders: gone with their owner; those of the dead go with the next, those of the living stay."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from excite.temporary_folder import TemporaryFolder

_OWNER = """
import os, signal, sys
from excite.temporary_folder import TemporaryFolder
folder = TemporaryFolder()
(folder.path / "deep").mkdir()
(folder.path / "deep" / "value").write_text("1")
print(folder.path, flush=True)
sys.stdin.read()
HOW
"""


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def _owner(how: str, place: Path) -> tuple[subprocess.Popen[str], Path]:
    run = subprocess.Popen(
        [sys.executable, "-c", _OWNER.replace("HOW", how)],
        env={**os.environ, "TMPDIR": str(place)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert run.stdout is not None
    return run, Path(run.stdout.readline().strip())


def test_a_folder_goes_with_the_last_that_refers_to_it(place: Path) -> None:
    folder = TemporaryFolder()
    path = folder.path
    assert path.parent == place and path.stat().st_mode & 0o077 == 0
    del folder
    gc.collect()
    assert list(place.iterdir()) == []


def test_folders_of_the_dead_go_and_those_of_the_living_stay(place: Path) -> None:
    living, kept = _owner("", place)
    dead, left = _owner("os.kill(os.getpid(), signal.SIGKILL)", place)
    dead.communicate()
    assert left.is_dir()
    mine = TemporaryFolder()
    assert not left.exists()
    assert kept.is_dir() and (kept / "deep" / "value").read_text() == "1"
    living.communicate()
    assert living.returncode == 0
    assert list(place.iterdir()) == [mine.path]


def test_what_only_has_such_a_name_is_nobodys_to_remove(place: Path) -> None:
    mine = TemporaryFolder()
    prefix = mine.path.name.rsplit("_", 1)[0]
    theirs = place / f"{prefix}_results"
    theirs.mkdir()
    (theirs / "plan.json").write_text("{}")
    (place / f"{prefix}_notes.txt").write_text("keep")
    (place / f"{prefix}_link").symlink_to(theirs)
    TemporaryFolder()
    assert (theirs / "plan.json").exists()
    assert (place / f"{prefix}_notes.txt").exists() and (place / f"{prefix}_link").exists()


def test_a_fork_does_not_take_the_folder_with_it() -> None:
    folder = TemporaryFolder()
    path = folder.path
    child = os.fork()
    if child == 0:
        del folder
        gc.collect()
        os._exit(0)
    os.waitpid(child, 0)
    assert path.is_dir()
