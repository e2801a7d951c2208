"""Whatever a folder's documents say, the report is a page or one clear error, and the page runs nothing."""

from __future__ import annotations

import json
import os
import warnings
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from excite.errors import ExciteError
from excite.motion.files import save_motion
from excite.report.page import report
from excite.robot.loading import load_robot
from tests.corpus.documents import arrays
from tests.documents.mutations import mutated
from tests.documents.small import SMALL
from tests.report.sample import sample_motion
from tests.report.scripts import strange_scripts

_PAGES = ("plan", "check", "identification", "campaign", "diagnosis")
_HOSTILE = "<script>alert(1)</script>\" onload='x' $\\frac{1}$ $ & <img src=x>"


class _Elements(HTMLParser):
    """Names of the elements on a page, their attributes, and its text."""

    def __init__(self) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.attributes: set[str] = set()
        self.text = ""

    def handle_starttag(self, tag, attrs):
        self.names.add(tag)
        self.attributes |= {name for name, _ in attrs}

    def handle_data(self, data):
        self.text += data


def elements(page: Path) -> _Elements:
    found = _Elements()
    found.feed(page.read_text(encoding="utf-8"))
    return found


@pytest.mark.parametrize("name", _PAGES)
def test_a_changed_document_gives_a_page_or_one_line(name: str, tmp_path: Path) -> None:
    random = np.random.default_rng(_PAGES.index(name))
    shown = 0
    for _ in range(40):
        document, what = mutated(SMALL[name], random)
        (tmp_path / f"{name}.json").write_text(json.dumps(document), encoding="utf-8")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                page = report(tmp_path)
        except ExciteError as error:
            assert len(str(error)) < 1000 and "\n" not in str(error), what
            assert f"{name}.json" in str(error), what
            continue
        shown += 1
        assert "img" not in elements(page).names, what
        assert strange_scripts(page.read_text(encoding="utf-8")) == [], what
    # Most changes are faults; a field that may be absent, or another name, is none.
    assert 0 < shown < 40


@pytest.mark.parametrize("name", _PAGES)
def test_promised_fields_are_enough_for_a_page(name: str, tmp_path: Path) -> None:
    (tmp_path / f"{name}.json").write_text(json.dumps(SMALL[name]), encoding="utf-8")
    assert "svg" in elements(report(tmp_path)).names or name in {"plan", "check", "identification"}


def _renamed(content: object) -> object:
    """The document with every text that is no word of the format, and every name, made hostile."""
    if isinstance(content, dict):
        return {
            key if key in _WORDS else f"{key}{_HOSTILE}": _renamed(value) if key not in _FIXED else value
            for key, value in content.items()
        }
    if isinstance(content, list):
        return [_renamed(item) for item in content]
    return content + _HOSTILE if isinstance(content, str) else content


def _keys(content: object) -> set[str]:
    if isinstance(content, dict):
        return set(content).union(*map(_keys, content.values()))
    return set().union(*map(_keys, content)) if isinstance(content, list) else set()


_NAMES = {"self_collision", "hand", "elbow_joint", "Izz(hand)", "m(hand)", "width"}
_WORDS = set().union(*(_keys(document) for document in SMALL.values())) - _NAMES
_FIXED = {"schema", "verdict"}


def test_names_are_text_and_nothing_else(tmp_path: Path) -> None:
    for name in _PAGES:
        (tmp_path / f"{name}.json").write_text(json.dumps(_renamed(SMALL[name])), encoding="utf-8")
    hostile = {
        key: np.array([f"{item}{_HOSTILE}" for item in value.ravel()]).reshape(value.shape)
        if value.dtype.kind == "U"
        else value
        for key, value in arrays().items()
    }
    np.savez(tmp_path / "report_data.npz", **hostile)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        path = report(tmp_path)
    page = elements(path)
    assert "img" not in page.names
    assert strange_scripts(path.read_text(encoding="utf-8")) == []
    assert "onload" not in page.attributes
    assert page.text.count("<script>alert(1)</script>") > 20 and "\\frac" in page.text


@pytest.mark.parametrize(
    "robot", ["/dev/zero", "pipe.yaml", "folder", "a" * 250, "../../robot.urdf", "gone.yaml"]
)
def test_a_robot_that_cannot_be_had_is_left_out(robot: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "folder").mkdir()
    for key in ("robot", "robot_file"):
        document = {**SMALL["plan"], "robot": "mine", key: robot}
        (tmp_path / "plan.json").write_text(json.dumps(document), encoding="utf-8")
        assert "pictures of the robot: " in report(tmp_path).read_text(encoding="utf-8")


def test_a_motion_that_leaves_the_earth_is_left_out(tmp_path: Path) -> None:
    robot = load_robot("ur10")
    motion = sample_motion(robot, 0)
    far = replace(motion, name="far", q=motion.q + 1e200)
    entries = []
    for item in (motion, far):
        save_motion(item, tmp_path / f"{item.name}.parquet")
        entries.append({"motion": f"{item.name}.parquet", "segments": [], "duration_s": 6.0})
    plan = {**SMALL["plan"], "robot": "ur10", "selected": entries}
    (tmp_path / "plan.json").write_text(json.dumps(plan), encoding="utf-8")
    page = elements(report(tmp_path))
    assert "pictures of motion far.parquet: it goes beyond" in page.text
    assert "svg" in page.names and "pictures of motion motion_00" not in page.text


def test_numbers_that_are_not_known_are_dashes(tmp_path: Path) -> None:
    diagnosis = json.loads(json.dumps(SMALL["diagnosis"]))
    gap = diagnosis["gap"]
    gap |= {"before": None, "after": None, "share_closed": None, "share_closed_90": [None, 1.0]}
    gap["per_channel"]["elbow_joint"] |= {"before": None, "after": None, "noise_floor": None}
    diagnosis["simulation"] |= {"before": {"elbow_joint": None}, "after": {"elbow_joint": None}}
    diagnosis["where"][0] |= {"share": None, "band_hz": [None, None]}
    diagnosis["candidates"][0] |= {"share_closed": None, "evidence": None}
    (tmp_path / "diagnosis.json").write_text(json.dumps(diagnosis), encoding="utf-8")
    page = elements(report(tmp_path))
    assert "– → –" in page.text and "– to –" in page.text
    assert "nan" not in page.text
