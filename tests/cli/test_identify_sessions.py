"""``excite identify --sessions``: the pooled document and the file of ranges."""

from __future__ import annotations

import json
from dataclasses import replace

import yaml
from typer.testing import CliRunner

from excite.cli.main import app
from excite.logs.files import save_log
from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log, changed


def test_sessions_are_pooled_and_ranges_written(tmp_path):
    robot = load_robot("ur10")
    log = replace(arm_log(robot, 0, trials=4, sessions=("am", "pm"), change=0.05), robot_text="<robot/>")
    folder = save_log(log, tmp_path / "log")
    arguments = ["identify", "ur10", str(folder), "--method", "wls", "--sessions", "--json"]
    run = CliRunner().invoke(app, [*arguments, "--out", str(tmp_path / "out")])
    assert run.exit_code == 0, run.output
    document = json.loads(run.stdout)
    assert document["sessions"]["names"] == ["am", "pm"]
    ranges = yaml.safe_load((tmp_path / "out" / "ranges.yaml").read_text())
    assert ranges["schema"] == "excite.ranges/1" and ranges["links"]


def test_findings_stand_as_notes(tmp_path):
    robot = load_robot("ur10")
    turned = changed(arm_log(robot, 0, trials=2), lambda t: replace(t, tau=-t.tau))
    folder = save_log(replace(turned, robot_text="<robot/>"), tmp_path / "log")
    run = CliRunner().invoke(app, ["identify", "ur10", str(folder), "--method", "wls"])
    assert run.exit_code == 0, run.output
    notes = [line for line in run.stdout.splitlines() if line.startswith("note: ")]
    assert any("all torques have the opposite sign" in line for line in notes)
