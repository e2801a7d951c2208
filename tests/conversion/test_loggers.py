"""Recordings as makers' interfaces and tools of machine learning write them, with their own names and units."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import excite
from tests.conversion import written
from tests.conversion.test_habits import check, table
from tests.conversion.written import WHOLE

pytestmark = pytest.mark.usefixtures("unexamined")


def _lines(file: Path, rows: list[dict[str, object]]) -> Path:
    file.write_text("\n".join(json.dumps(row) for row in rows) + "\n")
    return file


def test_lines_of_json_under_the_name_of_one_document(data, arm, tmp_path):
    """As JAKA's port 10000 sends them; the tool's position stands beside the joints'."""
    rows = [
        {
            "time_stamp": 1000.0 * data["time"][k],
            "actual_position": [300.0, 100.0 + k, 400.0],
            "joint_actual_position": np.degrees(data["q"][k]).tolist(),
            "joint_torque": data["tau"][k].tolist(),
        }
        for k in range(len(data["time"]))
    ]
    check(excite.convert([_lines(tmp_path / "a.json", rows)], arm, tmp_path / "log", WHOLE), data, "q", "tau")


def test_dates_in_json_are_times(data, arm, tmp_path):
    """A state of Flexiv's RDK, stamped by the program that logs it."""
    start = datetime(2026, 3, 2, 10, 0, tzinfo=UTC)
    rows = [
        {
            "time": str(start + timedelta(seconds=data["time"][k])),
            "q": data["q"][k].tolist(),
            "dq": data["v"][k].tolist(),
            "tau": data["tau"][k].tolist(),
            "tau_ext": [0.01 * (k % 3)] * 3,
        }
        for k in range(len(data["time"]))
    ]
    found = excite.convert([_lines(tmp_path / "a.jsonl", rows)], arm, tmp_path / "log", WHOLE)
    check(found, data, "q", "v", "tau")


def test_microseconds_of_lcm(data, arm, tmp_path):
    """``lcmt_iiwa_status`` of Drake."""
    rows = [
        {
            "utime": int(1e15 + 1e6 * data["time"][k]),
            "num_joints": 3,
            "joint_position_measured": data["q"][k].tolist(),
            "joint_velocity_estimated": data["v"][k].tolist(),
            "joint_torque_measured": data["tau"][k].tolist(),
            "joint_torque_external": [0.01 * (k % 3)] * 3,
        }
        for k in range(len(data["time"]))
    ]
    (tmp_path / "a.json").write_text(json.dumps(rows))
    check(excite.convert([tmp_path / "a.json"], arm, tmp_path / "log", WHOLE), data, "q", "v", "tau")


def test_least_and_largest_values_are_no_commands(data, arm, tmp_path):
    """Weights & Biases exports each series with its extremes, which are it where nothing was averaged."""
    columns = {"Step": np.arange(len(data["time"])), "run - time": data["time"]}
    for key, name in (("q", "pos"), ("tau", "effort")):
        for k, joint in enumerate(written.JOINTS):
            columns |= {f"run - {name}/{joint}{end}": data[key][:, k] for end in ("", "__MIN", "__MAX")}
    found = excite.convert([table(tmp_path / "wandb.csv", columns)], arm, tmp_path / "log", WHOLE)
    check(found, data, "q", "tau")
    assert found.log.trials[0].q_cmd is None


def test_a_current_along_q_is_no_position(data, arm, tmp_path):
    """A moteus reports POSITION, TORQUE and Q_CURRENT of each motor."""
    rows = [
        {
            "timestamp": data["time"][k],
            "servos": {
                str(j + 1): {
                    "POSITION": data["q"][k, j],
                    "VELOCITY": data["v"][k, j],
                    "TORQUE": data["tau"][k, j],
                    "Q_CURRENT": data["tau"][k, j] / 0.6,
                }
                for j in range(3)
            },
        }
        for k in range(len(data["time"]))
    ]
    found = excite.convert([_lines(tmp_path / "a.jsonl", rows)], arm, tmp_path / "log", WHOLE)
    check(found, data, "q", "v", "tau")


def test_torques_of_joints_stand_before_those_of_motors(data, arm, tmp_path):
    """Doosan's real-time state has both."""
    columns = {"time_stamp": data["time"]}
    for key, name, factor in (("q", "actual_joint_position", 1.0), ("tau", "actual_motor_torque", 0.01),
                              ("tau", "actual_joint_torque", 1.0)):  # fmt: skip
        columns |= {f"{name}_{k + 1}": factor * data[key][:, k] for k in range(3)}
    found = excite.convert([table(tmp_path / "rt.csv", columns)], arm, tmp_path / "log", WHOLE)
    check(found, data, "q", "tau")
