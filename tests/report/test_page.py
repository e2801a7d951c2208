"""The page: complete, self-contained, and honest about what it lacks."""

from __future__ import annotations

import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import pytest

from excite.errors import InputError
from excite.report.folder import read_folder
from excite.report.page import SECTIONS, render_page, report
from excite.robot.loading import load_robot
from tests.report.sample import sample_folder
from tests.report.scripts import strange_scripts, without_scripts

_VOID = {"meta", "br", "hr", "img", "input", "link"}


class _Outline(HTMLParser):
    """Ids, link targets, addresses, and whether every element is closed."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.targets: list[str] = []
        self.addresses: list[str] = []
        self.drawings = 0

    def handle_starttag(self, tag, attrs):
        if tag not in _VOID:
            self.open.append(tag)
        self._attributes(tag, attrs)

    def handle_startendtag(self, tag, attrs):
        self._attributes(tag, attrs)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def _attributes(self, tag, attrs):
        self.drawings += tag == "svg"
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            if name in {"href", "xlink:href", "src"}:
                (self.targets if value.startswith("#") else self.addresses).append(value)


@pytest.fixture(scope="module")
def folder(g1, tmp_path_factory) -> Path:
    return sample_folder(tmp_path_factory.mktemp("results"), g1, n_motions=2)


@pytest.fixture(scope="module")
def page(folder, tmp_path_factory) -> str:
    path = report(folder, tmp_path_factory.mktemp("out"))
    assert path.name == "report.html" and [file.name for file in path.parent.iterdir()] == [path.name]
    return path.read_text(encoding="utf-8")


def _outline(page: str) -> _Outline:
    outline = _Outline()
    outline.feed(page)
    assert outline.open == []
    return outline


def test_the_page_is_well_formed_and_needs_no_network(page):
    outline = _outline(page)
    assert outline.addresses == []
    assert not re.search(r"url\((?!#)", without_scripts(page)) and "@import" not in page
    assert strange_scripts(page) == []
    assert "default-src 'none'" in page and "connect-src" not in page
    assert len(set(outline.ids)) == len(outline.ids)
    assert {target[1:] for target in outline.targets} <= set(outline.ids)


def test_every_section_and_every_figure_is_there(page):
    outline = _outline(page)
    # A campaign is of a robot; pages of a person and of a log are looked at elsewhere.
    assert {name for name, *_ in SECTIONS} - {"person", "moving", "findings"} <= set(outline.ids)
    assert outline.drawings == 7
    assert "Left out" not in page


@pytest.mark.parametrize(
    "fact",
    [
        "118 of 140",
        "1 of 2",
        "self_collision",
        "212",
        "181 of 190",
        "−76 %",
        "triangle inequality",
        "clipped in 12 samples &lt;of trial_03&gt;",
        "−0.00400",
        "mostly by the data",
        "feet may slip on a smoother floor",
    ],
)
def test_the_numbers_of_the_files_are_on_the_page(fact, page):
    assert fact in page


def test_same_folder_same_bytes(folder, page):
    assert render_page(read_folder(folder)) == page


def test_a_folder_with_a_plan_alone_says_what_is_missing(folder, tmp_path):
    shutil.copy(folder / "plan.json", tmp_path)
    shutil.copytree(folder / "motions", tmp_path / "motions")
    page = report(tmp_path).read_text(encoding="utf-8")
    outline = _outline(page)
    assert {"motions", "excitation"} <= set(outline.ids)
    assert not {"safety", "certainty", "forces", "masses", "parameters"} & set(outline.ids)
    for name in ("check.json", "identification.json", "campaign.json", "report_data.npz"):
        assert name in page


def test_motions_that_are_gone_are_said_to_be(folder, tmp_path):
    shutil.copy(folder / "plan.json", tmp_path)
    page = report(tmp_path).read_text(encoding="utf-8")
    assert "pictures of motion motions/motion_00.parquet" in page
    # What has no distance to tell counts all the same: as many are refused there as are not accepted.
    section = page[page.index('id="refused"') :]
    rows = re.findall(r"<tr>(.*?)</tr>", section[: section.index("</section>")], re.DOTALL)
    cells = [
        [re.sub(r"<[^>]+>", "", cell) for cell in re.findall(r"<td.*?</td>", row, re.DOTALL)] for row in rows
    ]
    assert {row[0]: row[2] for row in cells if row} == {"zmp": "4", "self collision": "17", "time limit": "1"}
    assert "1 candidate" not in page and "22 rejected candidates" in page


def test_a_robot_of_ones_own_is_found_by_its_file_or_left_out(folder, tmp_path):
    plan = json.loads((folder / "plan.json").read_text())
    plan["robot"] = "robot_of_my_own"
    (tmp_path / "plan.json").write_text(json.dumps(plan))
    page = report(tmp_path).read_text(encoding="utf-8")
    assert "robot_of_my_own" in page and "pictures of the robot: unknown robot" in page


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("plan.json", "{", "is no JSON"),
        ("check.json", "[]", "is no JSON object"),
        ("campaign.json", '{"schema": "excite.campaign/9"}', "schema is 'excite.campaign/9'"),
        ("other.txt", "", "holds none of"),
    ],
)
def test_bad_folders_are_one_error_and_leave_no_page(name, text, message, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=re.escape(message)):
        report(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_no_folder_is_an_error(tmp_path):
    with pytest.raises(InputError, match="is no folder"):
        report(tmp_path / "nowhere")


def test_a_check_of_a_bare_model_says_what_the_model_lacks_for_pictures(tmp_path: Path) -> None:
    (tmp_path / "mine.urdf").write_text("<robot name='mine'/>")
    (tmp_path / "out").mkdir()
    document = {
        "schema": "excite.check/1",
        "safe": True,
        "motions": [],
        "robot": "mine",
        "robot_file": "../mine.urdf",
    }
    (tmp_path / "out" / "check.json").write_text(json.dumps(document))
    text = report(tmp_path / "out").read_text(encoding="utf-8")
    assert "mine.urdf: robot: has no &lt;link&gt;" in text and "unknown robot" not in text


# What sessions agree on and what varies between them, on the page of an identification.


def test_what_varies_between_sessions_stands_in_the_open(tmp_path):
    ur10 = load_robot("ur10")
    document = json.loads((sample_folder(tmp_path / "all", ur10) / "campaign.json").read_text())[
        "identification"
    ]
    folder = tmp_path / "days"
    folder.mkdir()
    file = folder / "identification.json"
    session = {"value": 20.0, "std": 0.1}
    steady = {
        "name": "mx(upper_arm_link)",
        "expression": "mx(upper_arm_link)",
        "value": 0.5,
        "between_std": 0.0,
        "varies": False,
        "low": 0.4,
        "high": 0.6,
        "by_session": {"mon": {"value": 0.5, "std": 0.02}, "tue<b>": {"value": 0.5, "std": 0.02}},
    }
    friction = {
        **steady,
        "name": "viscous(elbow_joint)",
        "varies": True,
        "low": 0.0,
        "high": 67.0,
        "by_session": {"mon": session, "tue<b>": {"value": 25.0, "std": 0.1}},
    }
    names = ["mon", "tue<b>"]
    document["sessions"] = {"names": names, "left_out": {}, "level": 0.95, "parameters": [steady, friction]}
    file.write_text(json.dumps(document))
    page = report(folder).read_text()
    block = page[page.index('id="sessions"') :]
    open_part, folded = block[: block.index("<details")], block[block.index("<details") :]
    assert "1 of 2 of the base parameters differs between 2 sessions (mon, tue&lt;b&gt;)" in open_part
    assert "viscous(elbow_joint)" in open_part and "20.0 ± 0.10" in open_part and "0 … 67.0" in open_part
    assert (
        "mx(upper_arm_link)" not in open_part and "mx(upper_arm_link)" in folded[: folded.index("</details>")]
    )
    friction["varies"] = False
    file.write_text(json.dumps(document))
    assert "None of the base parameters differ between 2 sessions" in report(folder).read_text()


# The page of a person holds both tables beside what was identified, and the ground reaction.

FIT = {"unit": "N", "rmse": 14.1, "cc": 0.97, "reference_rmse": 130.0, "reference_cc": 0.9, "std": 700.0}


def test_tables_stand_on_the_page(tmp_path):
    human = {
        "schema": "excite.human/1",
        "table": "de_leva",
        "segments": [{"segment": "pelvis", "de_leva_kg": 8.3775, "dumas_kg": 10.6287}],
    }
    (tmp_path / "human.json").write_text(json.dumps(human))
    page = report(tmp_path).read_text(encoding="utf-8")
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page))
    assert "de Leva 1996 [kg]" in text and "Dumas 2007 [kg]" in text
    assert "pelvis 8.38 10.6" in text
