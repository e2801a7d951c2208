"""The folder that ``excite human`` writes: what it replaces, what it keeps, and its page."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from excite.cli.main import app
from excite.human.measure import MeasuredPerson
from excite.logs.files import save_log
from excite.report.page import report
from tests.human.conftest import Session
from tests.human.recordings import write_c3d

pytestmark = pytest.mark.usefixtures("readers_here")


@pytest.fixture(scope="module")
def folder(session: Session, person: MeasuredPerson, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Written where an earlier run had written, and somebody a note."""
    place = tmp_path_factory.mktemp("person")
    trial = write_c3d(session.trial, place / "walk.c3d")
    static = write_c3d(replace(session.static, plates=session.trial.plates), place / "standing.c3d")
    out = place / "out"
    save_log(person.log, out)
    for name in ("identification.json", "notes.txt"):
        (out / name).write_text("")
    before = {
        "schema": "excite.human/1",
        "table": "de_leva",
        "segments": [],
        "files": ["identification.json"],
    }
    (out / "human.json").write_text(json.dumps(before))
    who = ["--mass", "70", "--height", "1.82", "--sex", "male", "--out", str(out)]
    run = CliRunner().invoke(app, ["human", str(trial), "--static", str(static), *who])
    assert run.exit_code == 0, run.output
    return out


def test_what_was_written_before_goes_and_all_else_stays(folder: Path) -> None:
    left = {path.name for path in folder.iterdir()}
    written = json.loads((folder / "human.json").read_text())["files"]
    assert left == {*written, "notes.txt"} and {"human.json", "log.yaml", "robot.yaml"} <= set(written)


def test_the_page_says_what_was_measured_and_shows_it_move(folder: Path) -> None:
    page = report(folder).read_text(encoding="utf-8")
    assert "1 trial of a person, whose markers fit the calibrated body to" in page
    assert f"excite identify {folder}/robot.yaml {folder} --out segments" in page
    assert 'data-replay="moving-replay' in page
