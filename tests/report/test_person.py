"""The page of a person holds both tables beside what was identified, and the ground reaction."""

from __future__ import annotations

import json
import re

from excite.report.page import report

FIT = {"unit": "N", "rmse": 14.1, "cc": 0.97, "reference_rmse": 130.0, "reference_cc": 0.9, "std": 700.0}


def test_tables_and_ground_reaction_stand_on_the_page(tmp_path):
    human = {
        "schema": "excite.human/1",
        "table": "de_leva",
        "segments": [{"segment": "pelvis", "de_leva_kg": 8.3775, "dumas_kg": 10.6287}],
        "ground_reaction": {"validation": {"fz": FIT}},
    }
    (tmp_path / "human.json").write_text(json.dumps(human))
    page = report(tmp_path).read_text(encoding="utf-8")
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page))
    assert "de Leva 1996 [kg]" in text and "Dumas 2007 [kg]" in text
    assert "pelvis 8.38 10.6" in text
    assert "Ground reaction, trials that were left out" in text and "fz [N] 14.1 0.970 130 0.900" in text
