"""The first sentence of a page: what was found, whether it is good enough, the command to go on with."""

from __future__ import annotations

import json
import os
import re
from html import unescape
from pathlib import Path
from typing import Any

import pytest

from excite.errors import InputError
from excite.provenance import made_by
from excite.report.page import report
from excite.report.sections.diagnosed import rollout_share
from excite.results import write_json
from tests.documents.small import SMALL


def answer(folder: Path, **documents: dict[str, Any]) -> tuple[str, str]:
    """The text of the first section, and whether it is marked good."""
    for name, document in documents.items():
        (folder / f"{name}.json").write_text(json.dumps(document), encoding="utf-8")
    page = report(folder).read_text(encoding="utf-8")
    mark, content = re.search(r'<section id="answer" class="answer ?(\w*)">(.*?)</section>', page).groups()
    assert page.index('id="answer"') < page.index('class="tiles"' if 'class="tiles"' in page else "</main>")
    return unescape(re.sub(r"<[^>]+>", "", content)), mark


def test_a_plan_says_what_is_to_be_expected(tmp_path: Path) -> None:
    motion = {"motion": "a.parquet", "segments": ["hand"], "duration_s": 8.0}
    forecast = {
        "target_rsd_percent": 15.0,
        "seconds": 8.0,
        "within": 3,
        "essential": 4,
        "needed_s": {"m(hand)": 70.0, "Ixx(hand)": 2.0},
    }
    plan = {**SMALL["plan"], "robot": "ur10", "selected": [motion], "forecast": forecast}
    text, mark = answer(tmp_path, plan=plan)
    assert "1 motion of 8 s in all" in text and "3 of 4 essential parameters" in text
    assert "expected within 15 %" in text
    assert "1 more would take motion like this for 70 s in all." in text and mark == ""
    assert f"excite capture ur10 {tmp_path}" in text
    # What nobody has the patience for is not said in seconds.
    needed = {"m(hand)": 70.0, "my(hand)": 20.0, "Ixx(hand)": 9e4}
    text, _ = answer(tmp_path, plan={**plan, "forecast": {**forecast, "needed_s": needed}})
    assert (
        "2 more would take motion like this for 20 s to 70 s in all; 1 would take more than 10 times as much"
        in text
    )
    text, mark = answer(tmp_path, plan={**plan, "forecast": {**forecast, "within": 4}})
    assert "which is enough" in text and mark == "yes"
    text, mark = answer(tmp_path, plan={**plan, "selected": []})
    assert text.startswith("None of") and mark == "no" and "excite plan ur10" in text


def test_unsafe_motions_come_first(tmp_path: Path) -> None:
    check = json.loads(json.dumps(SMALL["check"]))
    check["motions"] = [{**check["motions"][0], "motion": "good", "safe": True, "violations": []}]
    check["motions"].append({**check["motions"][0], "motion": "bad", "safe": False})
    text, mark = answer(tmp_path, check=check)
    assert "1 of 2 motions do not pass the independent check: do not run bad." in text and mark == "no"
    check["motions"].pop()
    text, mark = answer(tmp_path, check=check)
    assert "safe to run" in text and mark == "yes"


def test_an_identification_is_judged_by_what_it_was_not_fitted_to(tmp_path: Path) -> None:
    fits = {name: {"rmse": 0.2, "cc": 0.9, "reference_rmse": 1.0, "reference_cc": 0.5} for name in ("a", "b")}
    found = {**SMALL["identification"], "robot": "ur10", "validation": fits}
    text, mark = answer(tmp_path, identification=found)
    assert "2 of 2 channels" in text and "error −80 %" in text and mark == "yes"
    assert "excite model" in text
    fits["b"] = {**fits["b"], "rmse": 3.0}
    text, mark = answer(tmp_path, identification=found)
    assert "1 of 2 channels" in text and "not to be used" in text and mark == "no" and "excite doctor" in text
    text, mark = answer(tmp_path, identification={**found, "validation": {}})
    assert "nobody knows how good they are" in text and mark == ""


def test_an_identification_that_is_spoilt_is_not_good_enough_however_it_predicts(tmp_path: Path) -> None:
    fits = {
        name: {"rmse": 0.1, "cc": 1.0, "reference_rmse": 0.5, "reference_cc": 0.9} for name in ("one", "two")
    }
    found = {**SMALL["identification"], "robot": "ur10", "validation": fits, "log_file": "../log"}
    found["fit"] = {name: {**fit, "rmse": 0.02} for name, fit in fits.items()}
    gap = {"kind": "validation_gap", "text": "one: larger"}
    spoilt = {"kind": "other_machine", "text": "the trials are of two robots", "severity": "spoils"}
    text, mark = answer(tmp_path, identification={**found, "findings": [gap]})
    assert "1 of them leave up to 5" in text and mark == "no" and "excite diagnose" in text
    text, mark = answer(tmp_path, identification={**found, "findings": [spoilt]})
    assert "the trials are of two robots; not to be relied on" in text and mark == "no"
    more = {"kind": "extension", "text": "with factors on the torques", "severity": "note"}
    text, mark = answer(tmp_path, identification={**found, "fit": fits, "findings": [more]})
    assert "good enough" in text and "more than bodies and friction" in text and mark == "yes"
    assert "excite diagnose" in text
    mended = {**spoilt, "repaired": True}
    text, mark = answer(tmp_path, identification={**found, "findings": [mended]})
    assert "good enough" in text and mark == "yes"


def test_it_says_which_command_made_it_and_when(tmp_path: Path) -> None:
    with made_by("excite check ur10 'my arm'", "1.2.3", 7):
        write_json(SMALL["check"], tmp_path / "check.json")
    os.utime(tmp_path / "check.json", (1.7e9, 1.7e9))
    said, _ = answer(tmp_path)
    assert "check.json made by excite check ur10 'my arm', excite 1.2.3, seed 7, 2023-11-14 22:13 UTC" in said
    write_json(SMALL["check"], tmp_path / "check.json")
    assert "made" not in json.loads((tmp_path / "check.json").read_text())
    assert "check.json written 2" in answer(tmp_path)[0]


def test_roll_outs_are_counted_as_the_gap_is() -> None:
    def share(before: dict, after: dict, floor: dict) -> float | None:
        return rollout_share({"before": before, "after": after, "floor": floor})

    # 1 − (2² − 1)/(10² − 1), and a channel that errs by no more than noise makes says nothing.
    assert share({"a": 10.0, "b": 1.1}, {"a": 2.0, "b": 1.1}, {"a": 1.0, "b": 1.0}) == pytest.approx(
        1 - 3 / 99
    )
    assert share({"a": 1.1}, {"a": 1.0}, {"a": 1.0}) is None
    # Without a floor, of the squares.
    assert share({"a": 2.0}, {"a": 1.0}, {}) == pytest.approx(0.75)


def test_figures_that_differ_are_explained_where_they_stand(tmp_path: Path) -> None:
    found = json.loads(json.dumps(SMALL["diagnosis"]))
    joints = {"elbow": 0.5}
    rollouts = {"before": joints, "after": joints, "floor": {"elbow": 0.01}, "horizon_s": 0.5, "model": None}
    effect = found["candidates"][0] if found["candidates"] else found["effects"][0]
    found |= {"effects": [effect], "simulation": rollouts, "verdict": "effect"}
    found["gap"] |= {"share_closed": 0.99}
    (tmp_path / "diagnosis.json").write_text(json.dumps(found), encoding="utf-8")
    page = unescape(report(tmp_path).read_text(encoding="utf-8"))
    assert "99 % and 0 % are both right" in page and "leaves the effects out" in page
    found["simulation"]["after"] = {"elbow": 0.02}
    (tmp_path / "diagnosis.json").write_text(json.dumps(found), encoding="utf-8")
    assert "are both right. The first is what the effects explain" not in report(tmp_path).read_text()


def test_a_diagnosis_says_whether_what_is_left_is_little(tmp_path: Path) -> None:
    found = json.loads(json.dumps(SMALL["diagnosis"]))
    found |= {
        "verdict": "effect",
        "sentence": "arm: the gap is armature at a; adding it closes most of it.",
        "log": [],
    }
    found["gap"] |= {"before": 0.2, "after": 0.021, "noise_floor": 0.02, "share_closed": 0.99}
    text, mark = answer(tmp_path, diagnosis=found)
    assert (
        "What is left is 1.1 times the noise: good enough for motions like these." in text and mark == "yes"
    )
    found["gap"] |= {"after": 0.1, "share_closed": 0.76}
    text, mark = answer(tmp_path, diagnosis=found)
    assert "What is left is 5.0 times the noise: not good enough yet." in text and mark == "no"
    found["gap"] |= {"share_closed": None}
    assert "times the noise" not in answer(tmp_path, diagnosis=found)[0]


def test_a_log_says_what_makes_a_page_of_it(tmp_path: Path) -> None:
    (tmp_path / "log.yaml").write_text("schema: excite.log/1\n", encoding="utf-8")
    with pytest.raises(
        InputError, match="is a log, which has no page of its own; excite doctor, identify or diagnose"
    ):
        report(tmp_path)


def test_an_empty_folder_says_what_writes_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds none of plan\.json.*excite plan, check, identify, diagnose"):
        report(tmp_path)
    (tmp_path / "plan.json").write_text("{", encoding="utf-8")
    with pytest.raises(InputError, match=r"plan\.json.*write it again with excite plan") as error:
        report(tmp_path)
    assert "\n" not in str(error.value)
    (tmp_path / "plan.json").unlink()
    (tmp_path / "check.json").write_text(json.dumps(SMALL["check"]), encoding="utf-8")
    page = report(tmp_path).read_text(encoding="utf-8")
    assert "(identification.json), which excite identify ROBOT LOG --out DIR writes" in page


def test_a_campaign_counts_the_motions_of_all_its_iterations(tmp_path: Path) -> None:
    campaign = json.loads(json.dumps(SMALL["campaign"]))
    step = campaign["iterations"][0]
    campaign["iterations"] = [{**step, "n_motions": 4}, {**step, "n_motions": 1}]
    assert "After 2 iterations and 5 motions" in answer(tmp_path, campaign=campaign)[0]
