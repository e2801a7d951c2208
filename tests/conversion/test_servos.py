"""What bus servos and drivers without torque sensors write: fields nobody fills, supplies, drives that are off."""

from __future__ import annotations

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

import excite
from excite.cli.main import app
from excite.conversion.guesses import UnclearError
from tests.conversion.test_habits import columns_of, table
from tests.conversion.written import JOINTS, WHOLE


@pytest.mark.parametrize(("channel", "name"), [("tau", "effort"), ("i", "current"), ("volt", "load")])
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_a_field_that_nobody_fills_is_no_torque(channel, name, value, data, arm, tmp_path):
    """Such logs hold commands and positions; nothing is asked of what one unit of the field is worth."""
    filled = {**data, "q_cmd": np.roll(data["q"], -2, axis=0), "x": np.full_like(data["q"], value)}
    columns = columns_of(filled, q="{joint}/position", q_cmd="{joint}/goal_position", x=f"{{joint}}/{name}")
    found = excite.convert([table(tmp_path / "s.csv", columns)], arm, tmp_path / "log", WHOLE)
    assert found.log.header.torque == "none"
    (said,) = [row for row in found.guesses if row[0] == "nothing"]
    assert name in said[1] and "same number in every row" in said[2]


def test_one_dead_channel_among_live_ones_is_a_fault_and_stays(data, arm, tmp_path):
    dead = data["tau"] * (np.arange(len(JOINTS)) != 1)
    columns = columns_of({**data, "tau": dead}, q="q_{joint}", tau="tau_{joint}")
    found = excite.convert([table(tmp_path / "s.csv", columns)], arm, tmp_path / "log", WHOLE)
    assert found.log.header.torque != "none"
    assert found.chart is not None and any(JOINTS[1] in finding.where for finding in found.chart.findings)


def test_velocities_that_nobody_fills_are_left_out(data, arm, tmp_path):
    columns = columns_of({**data, "v": 0.0 * data["v"]}, q="q_{joint}", v="v_{joint}", tau="tau_{joint}")
    found = excite.convert([table(tmp_path / "s.csv", columns)], arm, tmp_path / "log", WHOLE)
    assert not any(target.startswith("v.") for target in found.columns)


def test_the_supply_of_a_servo_is_no_drive_voltage(data, arm, tmp_path):
    """What moves a joint both ways changes its sign, whatever it is called."""
    noise = 0.1 * np.random.default_rng(1).standard_normal(data["q"].shape)
    columns = columns_of({**data, "x": 12.0 + noise}, q="q_{joint}", x="{joint}_input_voltage")
    found = excite.convert([table(tmp_path / "s.csv", columns)], arm, tmp_path / "log", WHOLE)
    assert found.log.header.torque == "none"
    columns = columns_of({**data, "x": noise}, q="q_{joint}", x="{joint}_input_voltage")
    with pytest.raises(UnclearError, match="input_voltage is a voltage"):
        excite.convert([table(tmp_path / "d.csv", columns)], arm, tmp_path / "log", WHOLE)


@pytest.mark.parametrize("name", ["torque_enable", "motors_enabled", "servo_on", "Enabled", "drive powered"])
def test_rows_in_which_a_drive_was_off_are_left_out(name, data, arm, tmp_path):
    columns = columns_of(data, q="q_{joint}", tau="tau_{joint}")
    n = len(data["time"])
    columns[name] = (np.arange(n) < n // 2).astype(float)
    found = excite.convert([table(tmp_path / "s.csv", columns)], arm, tmp_path / "log", WHOLE)
    kept = pq.read_table(found.folder / found.log.header.trials[0].file)
    assert kept.num_rows == n // 2
    np.testing.assert_allclose(kept[f"q.{JOINTS[0]}"], data["q"][: n // 2, 0], atol=1e-6)
    assert any(name in note and f"{n - n // 2} of {n} rows" in note for note in found.notes)


@pytest.mark.parametrize("values", [np.zeros, np.ones])
def test_a_switch_that_never_turns_decides_nothing(values, data, arm, tmp_path):
    columns = columns_of(data, q="q_{joint}", tau="tau_{joint}")
    columns["torque_enable"] = values(len(data["time"]))
    found = excite.convert([table(tmp_path / "s.csv", columns)], arm, tmp_path / "log", WHOLE)
    assert pq.read_table(found.folder / found.log.header.trials[0].file).num_rows == len(data["time"])


def test_after_a_log_of_commands_comes_diagnose(data, arm, tmp_path):
    filled = {**data, "q_cmd": np.roll(data["q"], -2, axis=0)}
    file = table(tmp_path / "s.csv", columns_of(filled, q="q_{joint}", q_cmd="q_cmd_{joint}"))
    words = ["convert", str(file), "--robot", str(arm), "--out", str(tmp_path / "log")]
    done = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert done.exit_code == 0 and "then: excite diagnose" in done.stdout


def test_after_a_log_of_positions_alone_comes_a_plan_to_record_by(data, arm, tmp_path):
    file = table(tmp_path / "s.csv", columns_of(data, q="q_{joint}"))
    words = ["convert", str(file), "--robot", str(arm), "--out", str(tmp_path / "log")]
    done = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert done.exit_code == 0 and "no_torques" in done.stdout
    assert f"then: excite plan {arm} --out plan" in done.stdout and "excite diagnose" not in done.stdout
