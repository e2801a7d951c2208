"""Every bad input of the corpus ends in one line, with the right exit code, and leaves nothing behind."""

from __future__ import annotations

import importlib
import pkgutil
import re
import time
from pathlib import Path

import pytest

import tests.corpus
from excite.cli.main import _run_command
from excite.cli.outcome import EXIT_BAD_INPUT, EXIT_USAGE
from tests.corpus.case import Case

_LONGEST_SECONDS = 60.0


def _cases() -> list[Case]:
    modules = (
        importlib.import_module(f"tests.corpus.{module.name}")
        for module in pkgutil.iter_modules(tests.corpus.__path__)
        if module.name not in {"case", "test_corpus"}
    )
    return [case for module in modules for case in getattr(module, "CASES", ())]


CASES = _cases()


def test_names_are_unique() -> None:
    names = [(case.family, case.name) for case in CASES]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.family}-{case.name}".replace(" ", "_"))
def test_one_line_and_nothing_written(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = case.build(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    start = time.monotonic()
    code = _run_command(arguments)
    seconds = time.monotonic() - start
    said = capfd.readouterr().err
    lines = said.splitlines()
    assert len(lines) == 1, said
    assert lines[0].startswith("excite: ")
    assert re.search(case.line, lines[0]), lines[0]
    assert "Traceback" not in said and "nobody foresaw" not in said
    assert code in {EXIT_BAD_INPUT, EXIT_USAGE}
    assert sorted(tmp_path.rglob("*")) == before
    assert seconds < _LONGEST_SECONDS
