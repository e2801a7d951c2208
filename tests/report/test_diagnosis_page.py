"""The page of a diagnosis: its sentence, its numbers, and what it says where nothing was accepted."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from excite.diagnosis.answer.answer import Diagnosis
from excite.errors import InputError
from excite.report.comparisons import ReportData, save_report_data
from excite.report.page import report
from excite.results import write_json
from tests.report.diagnosed import ambiguous, trial, two_joints_diagnosed, unknown


def page_of(diagnosis: Diagnosis, folder: Path, curves: bool = True) -> str:
    write_json(diagnosis.to_json(), folder / "diagnosis.json")
    if curves:
        save_report_data(ReportData(gap=trial()), folder / "report_data.npz")
    return report(folder).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    return page_of(two_joints_diagnosed(), tmp_path_factory.mktemp("diagnosis"))


@pytest.mark.parametrize(
    "fact",
    [
        "arm &lt;of mine&gt;: the gap is joint spring at shoulder (0.75 ± 0.01 N·m) and backlash at elbow; adding both",
        "closes 99 % of the gap above the noise.",
        "31 % → 4 %",
        "90 % interval 93 to 100 %",
        "98 %",  # of the squared error of roll-outs, of which a hundredth and a twenty-fifth are left
        "torque at zero 0.7500 ± 0.01 N·m",
        "87 %",
        "0.1 to 1.5",
        "15 → 1.25",
        "Trial val",
        "move the elbow with its load The motion is in next.parquet.",
        "elbow clips in 12 samples &lt;of a&gt;",
        "judged on one trial",
        "the simulator ignores something",
    ],
)
def test_what_was_found_is_on_the_page(fact: str, page: str) -> None:
    assert fact in page


def test_a_diagnosis_alone_misses_no_plan(page: str, tmp_path: Path) -> None:
    assert "Left out" not in page and "Diagnosis of the gap" in page
    bare = page_of(two_joints_diagnosed(), tmp_path, curves=False)
    assert "curves of a trial (report_data.npz)" in bare and "plan.json" not in bare
    assert "A trial before and after" not in bare


def test_what_cannot_be_told_apart_stands_alike(tmp_path: Path) -> None:
    page = page_of(ambiguous(two_joints_diagnosed()), tmp_path)
    assert page.count("<td>as likely</td>") == 2
    assert "this record cannot say which; adding one closes" in page


def test_of_an_unknown_gap_nothing_is_said_to_close(tmp_path: Path) -> None:
    diagnosis = unknown(two_joints_diagnosed())
    page = page_of(diagnosis, tmp_path)
    said = "there is a gap at shoulder that follows position and that no effect in the library explains"
    assert said in page and "None was accepted." in page
    assert "with the effects" not in page and "is closed" not in page


def test_another_schema_is_one_error(tmp_path: Path) -> None:
    (tmp_path / "diagnosis.json").write_text(json.dumps({"schema": "excite.diagnosis/9"}))
    with pytest.raises(InputError, match=r"diagnosis\.json.*schema is 'excite\.diagnosis/9'"):
        report(tmp_path)
    assert not (tmp_path / "report.html").exists()
