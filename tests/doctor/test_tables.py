"""Tables of the doctor: every threshold is used and says what set it, every kind of finding has a severity."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import excite
from excite.data_tables import read_rows
from excite.doctor.case import KINDS
from excite.doctor.examine import FOUND
from excite.finding import Severity

ROOM = Path(excite.__file__).parent / "doctor"


def test_every_threshold_is_used_and_says_what_set_it() -> None:
    rows = read_rows(str(ROOM / "thresholds.py"), "thresholds.csv")
    names = [row["name"] for row in rows]
    source = "".join(path.read_text(encoding="utf-8") for path in ROOM.rglob("*.py"))
    assert set(re.findall(r"THRESHOLD\.(\w+)", source)) == set(names) and len(set(names)) == len(names)
    assert all(float(row["value"]) > 0.0 and row["what it is"] and row["what set it"] for row in rows)


def test_every_kind_of_finding_has_a_severity_and_how_sure_it_is() -> None:
    assert set(KINDS) <= FOUND
    for kind, row in KINDS.items():
        assert row["severity"] in get_args(Severity) and 0.0 < row["sure"] <= 1.0, kind
