"""``excite campaign``: what it ends with."""

from __future__ import annotations

import re
from html import unescape
from pathlib import Path

import pytest
from typer.testing import CliRunner

from excite.cli.main import app


def test_it_ends_with_the_command_that_its_page_proposes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(
        app, ["campaign", "so101", "--candidates", "4", "--max-iterations", "1", "--out", "out"]
    )
    assert done.exit_code in (0, 1), done.exception
    (then,) = re.findall(r"^then: (excite .*)$", done.stdout, re.MULTILINE)
    page = unescape((tmp_path / "out" / "report.html").read_text(encoding="utf-8"))
    assert f"<code>{then}</code>" in page
