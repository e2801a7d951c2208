"""The page of simulators says of every format what the registry says of it."""

from __future__ import annotations

import re

from excite.export.models.model_format import JOINT_TERMS, SERVO_TERMS
from excite.export.registry import MODEL_FORMATS
from tests.manual.pages import DOCS

PAGE = (DOCS / "simulators.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.splitlines()
    if line.startswith("|")
]
HEAD, CELLS = [name.strip("`") for name in ROWS[0]], {row[0]: row[1:] for row in ROWS[2:]}
NAMES = {name: row for row in CELLS for name in re.findall(r"`(\w+)`", row)}


def test_the_table_has_a_column_for_every_format_and_a_row_for_every_term() -> None:
    assert HEAD[1:] == list(MODEL_FORMATS)
    assert set(NAMES) == {*JOINT_TERMS, *SERVO_TERMS}


def test_what_it_calls_lost_is_what_a_format_lacks() -> None:
    for term, row in NAMES.items():
        for name, cell in zip(MODEL_FORMATS, CELLS[row], strict=True):
            kind = MODEL_FORMATS[name]
            held = term in kind.held
            # What stays as its author wrote it is neither held nor lost.
            assert (cell == "lost") == (not held and cell != "the author's"), (term, name)
            assert cell != "the author's" or term not in kind.lacks
