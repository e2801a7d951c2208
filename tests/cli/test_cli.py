"""The command line as scripts and people use it: documents, exit codes, one-line errors."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet
import pytest
from typer.testing import CliRunner

from excite.cli.main import _run_command, app
from excite.logs.vocabulary import EFFECTS

COMMANDS = "robots effects init-robot plan check rank export simulate identify campaign report demo".split()


def excite(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run the installed command from another folder."""
    return subprocess.run(
        [sys.executable, "-m", "excite", *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": "200"},
        check=False,
    )


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which `excite plan` has put a plan for the UR10."""
    folder, said, error = tmp_path_factory.mktemp("cli"), io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(said), redirect_stderr(error):
        patch.chdir(folder)
        code = _run_command("plan ur10 --candidates 5 --seed 2 --jobs 1 --json --out plan".split())
    assert code == 0, error.getvalue()
    assert json.loads(said.getvalue())["schema"] == "excite.plan/1"
    assert error.getvalue() == ""
    return folder


Here = Callable[..., tuple[int, str]]


@pytest.fixture
def here(excite_here: Callable[..., subprocess.CompletedProcess[str]]) -> Here:
    """Runs a command in this process: exit code, stdout."""

    def run(*arguments: object, cwd: Path) -> tuple[int, str]:
        done = excite_here(*arguments, cwd=cwd)
        return done.returncode, done.stdout

    return run


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_and_the_common_options(command: str) -> None:
    done = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "200"})
    assert done.exit_code == 0
    for option in ("--json", "--seed", "--jobs", "--out"):
        assert option in done.stdout


def test_robots_lists_every_bundled_robot(here: Here, tmp_path: Path) -> None:
    document = json.loads(here("robots", "--json", cwd=tmp_path)[1])
    assert {"g1", "talos", "panda", "ur10", "human", "iiwa14"} <= {
        robot["name"] for robot in document["robots"]
    }


def test_effects_are_those_that_a_log_may_call_modelled(here: Here, tmp_path: Path) -> None:
    document = json.loads(here("effects", "--json", "--out", "kept", cwd=tmp_path)[1])
    assert json.loads((tmp_path / "kept" / "effects.json").read_text()) == document
    # An asymmetry is a form of the bias.
    assert {e["name"] for e in document["effects"]} == {*EFFECTS} - {"coulomb_asymmetry"}
    assert all(e["law"].endswith(".") and e["looks_like"] for e in document["effects"])
    for effect in (e for e in document["effects"] if e["base"] == "fixed"):
        assert {*effect["looks_like"].split(", ")} <= {*EFFECTS}
        assert effect["told_apart_by"] and effect["mujoco"]
    shown = CliRunner().invoke(app, ["effects"], env={"COLUMNS": "200"}).stdout
    assert all(name in shown for name in EFFECTS if name != "coulomb_asymmetry")


def test_paths_in_the_plan_are_relative_to_out(planned: Path) -> None:
    document = json.loads((planned / "plan" / "plan.json").read_text())
    for entry in document["selected"]:
        assert (planned / "plan" / entry["motion"]).is_file()
    assert (planned / "plan" / "report.html").read_text().startswith("<!doctype html>")


def test_check_rank_export_simulate_identify(planned: Path, here: Here) -> None:
    code, checked = here("check", "ur10", "plan", "--json", "--jobs", 1, cwd=planned)
    assert code == 0 and json.loads(checked)["safe"] is True
    code, ranked = here("rank", "ur10", "plan", "--json", cwd=planned)
    assert code == 0 and json.loads(ranked)["conditioning"]["n_base_parameters"] == 48
    code, exported = here(
        "export", "plan", "--format", "ros2", "--rate", 100, "--out", "ros", "--json", cwd=planned
    )
    assert code == 0
    assert all((planned / "ros" / file).exists() for file in json.loads(exported)["files"])
    assert here("simulate", "ur10", "plan", "--out", "log", "--json", "--jobs", 1, cwd=planned)[0] == 0
    one = json.loads((planned / "plan" / "plan.json").read_text())["selected"][0]["motion"]
    assert here("simulate", "ur10", f"plan/{one}", "--out", "one", "--json", "--jobs", 1, cwd=planned)[0] == 0
    code, identified = here("identify", "ur10", "log", "--json", "--out", "id", cwd=planned)
    assert code == 0
    document = json.loads(identified)
    assert document == json.loads((planned / "id" / "identification.json").read_text())
    for parameter in document["base_parameters"]:
        assert {"expression", "value", "std", "rsd_percent"} <= set(parameter)
    assert here("report", "id", cwd=planned)[0] == 0 and (planned / "id" / "report.html").is_file()


def test_an_unsafe_motion_ends_with_1_and_says_where(planned: Path, here: Here, tmp_path: Path) -> None:
    source = next((planned / "plan" / "motions").glob("*.parquet"))
    table = parquet.read_table(source)
    names = table.column_names
    columns = {name: table[name].to_numpy().copy() for name in names}
    columns["q.elbow_joint"] = columns["q.elbow_joint"] + 10.0
    parquet.write_table(
        pa.table(columns).replace_schema_metadata(table.schema.metadata), tmp_path / "bad.parquet"
    )
    code, said = here("check", "ur10", "bad.parquet", "--json", cwd=tmp_path)
    assert code == 1
    violations = json.loads(said)["motions"][0]["violations"]
    assert ("joint_position", "elbow_joint") in {(item["kind"], item["where"]) for item in violations}


def test_bad_input_is_one_line_and_4(
    planned: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    source = next((planned / "plan" / "motions").glob("*.parquet"))
    table = parquet.read_table(source)
    columns = {name: table[name].to_numpy().copy() for name in table.column_names}
    columns["q.elbow_joint"][3] = np.nan
    parquet.write_table(
        pa.table(columns).replace_schema_metadata(table.schema.metadata), tmp_path / "nan.parquet"
    )
    (tmp_path / "text.parquet").write_text("not parquet")
    (tmp_path / "robot.yaml").write_text("schema: excite.robot/1\nname: x\n")
    cases = [
        ("check", "ur10", "nan.parquet"),
        ("check", "ur10", "text.parquet"),
        ("check", "ur10", "missing.parquet"),
        ("check", "g1", source),
        ("rank", "no_such_robot", source),
        ("plan", "robot.yaml"),
        ("plan", "missing.yaml"),
        ("plan", "ur10", "--joint", "no_such_joint"),
        ("identify", "ur10", "no_such_log"),
        ("identify", "ur10", ".", "--method", "no_such_method"),
        ("export", source, "--format", "no_such_format"),
        ("simulate", "ur10", source, "--inject", "no_such_effect"),
        ("report", "no_such_folder"),
        ("init-robot", "missing.urdf"),
    ]
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    for case in cases:
        code = _run_command([*map(str, case), "--out", "out"])
        said = capfd.readouterr()
        assert code == 4, (case, code, said.err[-500:])
        assert said.out == "" and said.err.count("\n") == 1, (case, said.err)
        assert said.err.startswith("excite: ")
    assert sorted(tmp_path.iterdir()) == before, "something half-written was left behind"


def test_alone_it_shows_its_help(tmp_path: Path) -> None:
    done = excite(cwd=tmp_path)
    assert done.returncode == 2
    assert "Commands:" in done.stdout + done.stderr
    assert "nobody foresaw" not in done.stderr


def test_wrong_usage_is_2(tmp_path: Path, here: Here) -> None:
    assert here("plan", cwd=tmp_path)[0] == 2
    assert here("plan", "g1", "--candidates", 0, cwd=tmp_path)[0] == 2
    assert excite("no-such-command", cwd=tmp_path).returncode == 2
