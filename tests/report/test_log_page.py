"""The page of a log that was looked through, and that of motions that were checked: whose, how bad, what next."""

from __future__ import annotations

import json
import re
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from excite.cli.main import app
from excite.logs.files import save_log
from excite.motion.collection import load_motions
from excite.motion.files import save_motion
from excite.report.page import report
from excite.robot.loading import load_robot
from tests.diagnosis.two_joints import moved, two_joint_log


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng = np.random.default_rng(5)
    trials = tuple(moved(name, "identification", 8.0, rng, np.eye(2)) for name in "ab")
    return save_log(two_joint_log(trials), tmp_path_factory.mktemp("log") / "log")


def excite(*arguments: object) -> int:
    return CliRunner().invoke(app, [*map(str, arguments), "--jobs", "1", "--json"]).exit_code


def looked_through(log: Path, out: Path) -> str:
    assert excite("doctor", log, "--out", out) == 0
    return report(out).read_text(encoding="utf-8")


def out_of(log: Path, folder: Path) -> Path:
    looked_through(log, folder / "sound")
    return folder / "sound"


def text_of(page: str, identifier: str) -> str:
    content = re.search(rf'<section id="{identifier}".*?</section>', page, re.DOTALL)
    assert content is not None
    return unescape(re.sub(r"<[^>]+>", " ", content[0]))


def test_a_sound_log_goes_on_to_an_identification(log: Path, tmp_path: Path) -> None:
    page = looked_through(log, tmp_path)
    answer = text_of(page, "answer")
    assert "What is wrong with a log" in page and "Left out" not in page
    assert ('class="answer yes"' in page and "spoils what is computed" in answer) or "Nothing wrong" in answer
    # Of a robot that is not bundled the file that lies with the log.
    assert f"excite identify {log}/two.urdf {log} --out result" in answer
    # It is shown in motion.
    assert 'id="moving-replay-robot"' in page


def test_a_fault_is_said_first_with_what_is_to_be_done(log: Path, tmp_path: Path) -> None:
    looked_through(log, tmp_path)
    document = json.loads((tmp_path / "doctor.json").read_text())
    finding = {
        "kind": "units",
        "text": "torques of <first> look like currents",
        "severity": "spoils",
        "sure": 0.9,
        "remedy": "state the scale",
        "places": ["tau.first"],
        "trials": ["a"],
    }
    document["findings"] = [finding]
    (tmp_path / "doctor.json").write_text(json.dumps(document))
    page = report(tmp_path).read_text(encoding="utf-8")
    answer = text_of(page, "answer")
    assert "Torques of <first> look like currents: it spoils what is computed" in answer
    assert "Next: state the scale" in answer and 'class="answer no"' in page
    row = " ".join(text_of(page, "findings").split())
    assert (
        "spoils what is computed torques of <first> look like currents state the scale tau.first; in a 90 %"
        in row
    )


def test_a_check_says_of_which_robot(tmp_path: Path) -> None:
    motions = tmp_path / "plan"
    assert excite("plan", "ur10", "--candidates", 4, "--out", motions) in {0, 1}
    assert excite("check", "ur10", motions, "--out", tmp_path / "check") == 0
    page = report(tmp_path / "check").read_text(encoding="utf-8")
    assert "<h1>Universal Robots UR10</h1>" in page and "Safety of motions" in page
    assert "Next: export them for the controller" in text_of(page, "answer")


def test_a_check_shows_first_what_is_not_safe(tmp_path: Path) -> None:
    good = load_motions("ur10")[0]
    save_motion(good, tmp_path / "a_good.parquet")
    robot = load_robot("ur10")
    down = 0.5 * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, 501)))
    q = robot.rest + np.outer(down, [0.0, 1.2, 1.6, 0.5, 0.0, 0.0])  # through the table
    rows = np.column_stack([np.arange(501) * 0.008, q])
    names = ",".join(["time", *(f"q.{joint}" for joint in robot.joint_names)])
    np.savetxt(tmp_path / "b_bad.csv", rows, delimiter=",", header=names, comments="")
    files = (tmp_path / "a_good.parquet", tmp_path / "b_bad.csv")
    assert excite("check", "ur10", *files, "--out", tmp_path / "check") == 1
    page = report(tmp_path / "check").read_text(encoding="utf-8")
    assert "do not run b_bad." in text_of(page, "answer")
    assert 0 < page.index('"b_bad · ') < page.index('"a_good · ')
