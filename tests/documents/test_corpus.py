"""Documents that were edited, cut, exchanged or made up end in one line, with the field and what to do."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from excite.cli.main import main
from tests.corpus.case import Case
from tests.corpus.documents import CASES


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.family}: {case.name}")
def test_a_bad_document_is_one_line(case: Case, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "argv", ["excite", *case.build(tmp_path)])
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr()
    lines = said.err.splitlines()
    assert ended.value.code == 4, said.err
    assert len(lines) == 1 and lines[0].startswith("excite: ")
    assert re.search(case.line, lines[0]), lines[0]
    assert len(lines[0]) < 1000 and "; " in lines[0]
    assert not said.out
    assert sorted(tmp_path.rglob("*")) == before


def test_names_of_cases_are_unique() -> None:
    names = [(case.family, case.name) for case in CASES]
    assert len(set(names)) == len(names)
