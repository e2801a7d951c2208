"""``excite diagnose``: what it writes beside what it prints."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from excite.campaign import applied as apply
from excite.cli.main import app
from excite.cli.results import _next_of_diagnosis
from excite.errors import RobotError
from excite.logs.files import save_log
from tests.diagnosis.two_joints import moved, two_joint_log


def test_a_diagnosis_ends_in_a_page_with_its_sentence(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    trials = (
        moved("a", "identification", 8.0, rng, np.eye(2)),
        moved("b", "validation", 5.0, rng, np.eye(2)),
    )
    log = save_log(two_joint_log(trials), tmp_path / "log")
    out = tmp_path / "out"
    found = CliRunner().invoke(app, ["diagnose", str(log), "--out", str(out)])
    assert found.exit_code == 0, found.exception
    document = json.loads((out / "diagnosis.json").read_text())
    assert found.stdout.startswith(document["sentence"])
    assert f"\nreport: {out / 'report.html'}\n" in found.stdout
    page = (out / "report.html").read_text(encoding="utf-8")
    assert document["sentence"] in page
    # Nothing was fitted on the trial that is shown, and its difference is the gap that is stated.
    with np.load(out / "report_data.npz") as data:
        left = data["gap/measured"] - data["gap/nominal"]
        assert str(data["gap/trial"]) == "b"
        stated = [item["before"] for item in document["gap"]["per_channel"].values()]
        np.testing.assert_allclose(np.sqrt((left**2).mean(axis=0)), stated, rtol=1e-6)
    hidden = [path.name for path in out.iterdir() if path.name.startswith(".")]
    assert not hidden and [path.name for path in tmp_path.iterdir() if path != out] == ["log"]


def three_trials(folder: Path, modelled: list[str]) -> Path:
    """A log of a robot with friction: two trials to identify, one to judge."""
    trials = [
        moved(name, role, 8.0, np.random.default_rng(seed), np.eye(2))
        for name, role, seed in (
            ("a", "identification", 1),
            ("b", "identification", 2),
            ("c", "validation", 3),
        )
    ]
    return save_log(two_joint_log(tuple(trials), modelled=modelled), folder / "log")


def test_the_robot_with_the_effects_is_what_the_next_diagnosis_starts_from(tmp_path: Path) -> None:
    """Friction that the log does not call modelled is found, written, and found no more."""
    log = three_trials(tmp_path, ["rigid_body"])
    robot = tmp_path / "robot"
    arguments = ["diagnose", str(log), "--no-budget", "--json"]
    found = CliRunner().invoke(app, [*arguments, "--apply", str(robot)])
    assert found.exit_code == 0, found.exception
    first = json.loads(found.stdout)
    assert first["verdict"] == "effect"
    assert (Path.cwd() / first["applied"]["robot"]).samefile(robot / "robot.yaml")
    assert first["applied"]["left_out"] == []
    assert any(text.startswith("coulomb [N·m]: first 1.") for text in first["applied"]["written"])
    again = CliRunner().invoke(app, [*arguments, "--robot", str(robot / "robot.yaml")])
    assert again.exit_code == 0, again.exception
    document = json.loads(again.stdout)
    assert document["verdict"] == "none" and document["effects"] == [] and "applied" not in document


def test_a_diagnosis_outlives_a_robot_that_it_does_not_make(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise RobotError("with what was found it is no robot", source="two")

    monkeypatch.setattr(apply, "apply_effects", refuse)
    log = three_trials(tmp_path, ["rigid_body", "viscous_friction", "coulomb_friction"])
    out = tmp_path / "out"
    done = CliRunner().invoke(
        app, ["diagnose", str(log), "--out", str(out), "--apply", str(tmp_path / "new")]
    )
    assert isinstance(done.exception, RobotError)
    assert (out / "report.html").is_file()
    assert "applied" not in json.loads((out / "diagnosis.json").read_text())


def test_a_second_diagnosis_that_would_say_the_same_is_not_proposed() -> None:
    effect = {"effect": "joint_spring"}
    found = {"verdict": "effect", "effects": [effect], "applied": {"left_out": ["joint spring at elbow: …"]}}
    assert _next_of_diagnosis(None, Path("log"), Path("better"), found) == ""
    both = found | {"effects": [effect, {"effect": "payload"}]}
    assert "--robot" in _next_of_diagnosis(None, Path("log"), Path("better"), both)


@pytest.mark.parametrize("named", ["", "log.yaml"])
def test_bodies_that_were_fitted_are_said_not_to_be_the_files(named: str, tmp_path: Path) -> None:
    """A payload is taken up by bodies that are fitted: whether the file is right, identification tells."""
    log = three_trials(tmp_path, ["rigid_body", "viscous_friction", "coulomb_friction"])
    out = tmp_path / "out"
    found = CliRunner().invoke(app, ["diagnose", str(log / named), "--out", str(out)])
    assert found.exit_code == 0, found.exception
    assert "the model, its bodies fitted to the record, " in found.stdout.splitlines()[0]
    then = f"then: excite identify {log / 'two.urdf'} {log / named} --out result"
    assert then in found.stdout
    again = ["diagnose", str(log / named), "--out", str(out), "--apply", str(tmp_path / "better")]
    applied = CliRunner().invoke(app, again)
    assert then in applied.stdout and "then: excite diagnose" not in applied.stdout
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Nothing beyond that needs to be corrected." in page
    # The page and the terminal name the same robot.
    assert (
        "log/two.urdf" in page
        and "log.yaml/two.urdf" not in page
        and "how far these bodies are from the file" in page
    )
