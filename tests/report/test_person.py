"""The page of a person holds both tables beside what was identified, and the ground reaction."""

from __future__ import annotations

import json
import re
from types import SimpleNamespace

import numpy as np

from excite.report.page import report
from excite.report.person_figures import save_person_figures
from tests.documents.small import SMALL

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


def test_masses_have_intervals_and_what_wrenches_are_of_is_said(tmp_path):
    """A table of forces in the pelvis' axes beside one in the laboratory's gave other figures of the same trial."""
    time = np.linspace(0.0, 1.0, 20)
    curves = np.sin(np.add.outer(6.0 * time, np.arange(6.0)))
    reaction = SimpleNamespace(
        trial="walk", role="validation", time=time, measured=curves, nominal=0.9 * curves, identified=curves
    )
    rows = [
        SimpleNamespace(segment=name, nominal={"de_leva": 8.0}, identified=7.0, std=std)
        for name, std in (("pelvis", 0.5), ("head", 0.25))
    ]
    found = SimpleNamespace(table=SimpleNamespace(rows=rows), reactions=[reaction])
    save_person_figures(found, None, "de_leva", tmp_path)
    human = {
        "schema": "excite.human/1",
        "table": "de_leva",
        "segments": [{"segment": "pelvis", "de_leva_kg": 8.0, "dumas_kg": 10.0}],
        "ground_reaction": {"validation": {"fz": FIT}},
    }
    (tmp_path / "human.json").write_text(json.dumps(human))
    (tmp_path / "identification.json").write_text(json.dumps(SMALL["identification"]))
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", report(tmp_path).read_text(encoding="utf-8")))
    assert "± 95 % [kg]" in text and "pelvis 8.00 7.00 0.980" in text and "head 8.00 7.00 0.490" in text
    assert "the tables are of the same wrench in the pelvis" in text
