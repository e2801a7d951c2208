"""A folder that results cannot go to is refused in one line before any work is done for it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from excite.atomic import write_text
from excite.cli.main import app
from excite.errors import InputError


@pytest.mark.parametrize("command", [["diagnose", "log"], ["plan", "ur10"], ["report", "here"]])
def test_a_file_is_no_folder_for_results(command: list[str], tmp_path: Path) -> None:
    file = tmp_path / "results"
    file.write_text("mine")
    for out in (file, file / "deeper"):
        found = CliRunner().invoke(app, [*command, "--out", str(out)])
        assert isinstance(found.exception, InputError)
        assert str(found.exception) == f"{file}: is a file, not a folder; give another --out"
    assert file.read_text() == "mine"


def test_a_folder_of_somebody_else_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The one who runs the tests may be allowed to write anywhere.
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != tmp_path)
    found = CliRunner().invoke(app, ["diagnose", "log", "--out", str(tmp_path / "new" / "deeper")])
    assert isinstance(found.exception, InputError)
    assert "may not be written to" in str(found.exception) and str(tmp_path) in str(found.exception)


def test_a_file_in_the_way_of_a_folder_is_one_error_and_nothing_is_left(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match=r"cannot be written .*; choose a folder that may be written to"):
        write_text(tmp_path / "file" / "page.html", "text")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
