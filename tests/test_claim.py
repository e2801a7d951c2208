"""Two runs do not write to one folder at once."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from excite.atomic import HIDDEN, claim_folder
from excite.errors import InputError

_CLAIM = """
import sys
from pathlib import Path
from excite.atomic import claim_folder
from excite.errors import InputError
try:
    with claim_folder(Path(sys.argv[1])):
        print("claimed", flush=True)
        sys.stdin.read()
except InputError as error:
    print(error)
"""


def start(folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", _CLAIM, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )


def said(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def test_the_second_run_is_refused_until_the_first_has_ended_or_was_killed(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    first = start(folder)
    assert said(first) == "claimed"
    with pytest.raises(InputError, match="out: is being written to by another run; wait until"):
        with claim_folder(folder):
            pass
    first.kill()
    first.wait()
    with claim_folder(folder), claim_folder(folder):
        second = start(folder)
        assert "is being written to by another run" in said(second)
        second.communicate("")


def test_a_folder_that_stayed_empty_goes_again_and_one_that_was_there_stays(tmp_path: Path) -> None:
    with claim_folder(tmp_path / "new" / "deeper"):
        assert (tmp_path / "new" / "deeper").is_dir()
    assert not (tmp_path / "new").exists()
    (tmp_path / "mine").mkdir()
    with claim_folder(tmp_path / "mine"):
        pass
    assert (tmp_path / "mine").is_dir()


def test_leftovers_of_a_killed_run_go_when_the_folder_is_claimed(tmp_path: Path) -> None:
    (tmp_path / "out" / f"{HIDDEN}0123456789abcdef").mkdir(parents=True)
    (tmp_path / "out" / ".mine").mkdir()
    with claim_folder(tmp_path / "out"):
        pass
    assert [path.name for path in (tmp_path / "out").iterdir()] == [".mine"]
