"""What was planned for a model of one's own is exported without naming the model again."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from excite.campaign.journal import CampaignSettings
from excite.campaign.loop import campaign
from excite.campaign.plan import plan
from excite.cli.main import _run_command
from excite.export.export import export_motions, robot_beside
from excite.motion.files import save_motion
from excite.report.view import read_thing
from excite.robot.load import keep_description, load_robot
from tests.robot.small import ARM
from tests.simulation.motions import standing


def _planned(folder: Path) -> Path:
    """A plan's folder: motions in one, the model's first description in another."""
    (folder / "mine.urdf").write_text(ARM, encoding="utf-8")
    robot = keep_description(load_robot(folder / "mine.urdf"), folder / "plan")
    (folder / "plan" / "motions").mkdir()
    save_motion(standing(robot), folder / "plan" / "motions" / "still.parquet")
    return folder / "plan"


def test_the_description_that_a_plan_kept_is_found(tmp_path: Path) -> None:
    plan = _planned(tmp_path)
    (written,) = export_motions([plan / "motions"], "csv", out=tmp_path / "out")
    assert written.is_file()
    motion = plan / "motions" / "still.parquet"
    assert robot_beside(motion, "mine") == str((plan / "robot" / "robot.yaml").resolve())
    assert robot_beside(motion, "another") == "another" and robot_beside(motion, "ur10") == "ur10"


@pytest.mark.parametrize("verb", ["plan", "campaign"])
def test_a_bare_model_is_found_again_by_what_was_made_of_it(verb: str, tmp_path: Path) -> None:
    """In another process, where the description that this one works with is gone."""
    (tmp_path / "mine.urdf").write_text(ARM, encoding="utf-8")
    out = tmp_path / "out"
    if verb == "plan":
        plan(tmp_path / "mine.urdf", n_candidates=6).save(out)
    else:
        campaign(tmp_path / "mine.urdf", out, CampaignSettings(n_candidates=6, max_iterations=1))
    documents = sorted({*out.glob("*.json"), *out.glob("iteration_1/plan.json")})
    told = {file: json.loads(file.read_text()).get("robot_file") for file in documents}
    there = {(file.parent / name).resolve() for file, name in told.items() if name}
    assert there == {(out / "robot" / "robot.yaml").resolve()}
    (motion, *_) = sorted(out.rglob("motions/*.parquet"))
    assert robot_beside(motion, "mine") == str(*there)


def test_motions_of_a_plan_are_watched_by_the_description_that_it_kept(tmp_path: Path) -> None:
    plan = _planned(tmp_path)
    for thing in (plan / "motions" / "still.parquet", plan / "motions"):
        shown = read_thing(thing)
        assert shown.robot.name == "mine" and len(shown.clips) == 1


def test_the_sheet_of_a_plan_is_written_by_the_robots_name(tmp_path: Path, monkeypatch, capsys) -> None:
    plan = _planned(tmp_path)
    document = {
        "schema": "excite.plan/1",
        "robot": "mine",
        "candidates": {"generated": 1, "accepted": 1, "rejected": {}},
        "selected": [{"motion": "motions/still.parquet", "segments": [], "duration_s": 1.0}],
        "validation": [],
        "conditioning": {"full": 10.0, "log_det": 1.0, "n_base_parameters": 36, "segments": []},
        "stages": [],
    }
    (plan / "plan.json").write_text(json.dumps(document))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert _run_command(["capture", "mine", str(plan)]) == 0
    assert (plan / "capture.md").is_file()
    # So does the next command, which knows nothing of the plan's folder.
    assert f"--robot {plan / 'robot' / 'robot.yaml'}" in " ".join(capsys.readouterr().out.split())


def test_the_next_command_names_a_robot_that_it_finds(tmp_path: Path) -> None:
    plan = _planned(tmp_path)
    command = [
        sys.executable,
        "-m",
        "excite",
        "export",
        str(plan),
        "--format",
        "csv",
        "--out",
        str(tmp_path / "o"),
    ]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert str(plan / "robot" / "robot.yaml") in " ".join(said.split())
