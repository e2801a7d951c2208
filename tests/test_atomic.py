"""Files appear whole or not at all, and what a killed writer left goes with the next one."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from excite.atomic import HIDDEN, all_or_nothing, atomic_path, write_text
from excite.errors import InputError

_KILLED = """
import os, signal, sys
from pathlib import Path
from excite.atomic import atomic_path
with atomic_path(Path(sys.argv[1])) as temporary:
    temporary.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""

_WRITE = """
import sys
from pathlib import Path
from excite.atomic import write_text
write_text(Path(sys.argv[1]), sys.argv[2])
"""


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_killed_writer_leaves_nothing_under_the_name_and_the_next_one_tidies_up(tmp_path: Path) -> None:
    (tmp_path / "page").write_text("old")
    done = subprocess.run([sys.executable, "-c", _KILLED, str(tmp_path / "page")], check=False)
    assert done.returncode == -signal.SIGKILL
    left = names(tmp_path)
    assert len(left) == 2 and left[0].startswith(HIDDEN) and (tmp_path / "page").read_text() == "old"
    subprocess.run([sys.executable, "-c", _WRITE, str(tmp_path / "page"), "new"], check=True)
    assert names(tmp_path) == ["page"] and (tmp_path / "page").read_text() == "new"


def test_what_another_writer_is_writing_is_left_alone(tmp_path: Path) -> None:
    with atomic_path(tmp_path / "slow") as temporary:
        temporary.write_text("slow")
        subprocess.run([sys.executable, "-c", _WRITE, str(tmp_path / "quick"), "quick"], check=True)
    assert names(tmp_path) == ["quick", "slow"]


def test_several_files_appear_together_or_not_at_all(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("old")
    with pytest.raises(RuntimeError), all_or_nothing():
        write_text(tmp_path / "a", "new")
        write_text(tmp_path / "deeper" / "b", "new")
        raise RuntimeError
    assert (tmp_path / "a").read_text() == "old" and names(tmp_path) == ["a"]
    with all_or_nothing():
        write_text(tmp_path / "a", "new")
        with all_or_nothing():
            write_text(tmp_path / "deeper" / "b", "new")
        assert (tmp_path / "a").read_text() == "old"
    assert (tmp_path / "a").read_text() == (tmp_path / "deeper" / "b").read_text() == "new"
    assert names(tmp_path) == ["a", "deeper"] and names(tmp_path / "deeper") == ["b"]


def test_a_full_disk_is_one_error_and_the_old_file_stays(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("old")
    with pytest.raises(
        InputError, match=r"a: cannot be written \(No space left on device\); make room"
    ) as caught:
        with atomic_path(tmp_path / "a"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert "\n" not in str(caught.value)
    assert names(tmp_path) == ["a"] and (tmp_path / "a").read_text() == "old"


def test_errors_that_are_not_of_the_file_pass(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), atomic_path(tmp_path / "a"):
        (tmp_path / "nowhere" / "else").read_text()


@pytest.mark.parametrize("name", ["x" * 300, "nul\0", "deep/" + "y" * 300 + "/file"])
def test_names_that_no_file_can_have_are_one_error(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        write_text(tmp_path / name, "text")


def test_a_name_of_full_length_can_be_written(tmp_path: Path) -> None:
    write_text(tmp_path / ("x" * 255), "text")
    assert names(tmp_path) == ["x" * 255]
