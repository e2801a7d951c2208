"""Tables of one value a row."""

from __future__ import annotations

import numpy as np
import pytest

import excite
from tests.conversion.test_habits import check, table
from tests.conversion.written import JOINTS, WHOLE

QUANTITIES = {"q": "position", "v": "velocity", "tau": "torque"}


def _rows(data: dict[str, np.ndarray]) -> list[tuple[str, str, np.ndarray]]:
    return [(name, joint, data[c][:, k]) for c, name in QUANTITIES.items() for k, joint in enumerate(JOINTS)]


def test_signals_in_turn_and_in_one_column_of_names(data, arm, tmp_path):
    """As data frames are melted: every sample of all signals, then the next one."""
    rows = _rows(data)
    columns = {
        "time": np.repeat(data["time"], len(rows)),
        "signal": [f"{joint}.{name}" for name, joint, _ in rows] * 600,
        "value": np.column_stack([values for _, _, values in rows]).ravel(),
    }
    found = excite.convert([table(tmp_path / "a.csv", columns)], arm, tmp_path / "log", WHOLE)
    check(found, data, "q", "v", "tau")


def test_signals_one_after_the_other_with_field_and_joint_apart(data, arm, tmp_path):
    """As InfluxDB gives out what was asked of it: a table a signal, when the query began and ended in each row."""
    rows = _rows(data)
    columns = {
        "result": ["r"] * (600 * len(rows)),
        "table": np.repeat(np.arange(len(rows)), 600),
        "_start": np.full(600 * len(rows), 1.7e9),
        "_time": np.tile(data["time"], len(rows)),
        "_value": np.concatenate([values for _, _, values in rows]),
        "_field": np.repeat([name for name, _, _ in rows], 600).tolist(),
        "joint": np.repeat([joint for _, joint, _ in rows], 600).tolist(),
    }
    found = excite.convert([table(tmp_path / "a.csv", columns)], arm, tmp_path / "log", WHOLE)
    check(found, data, "q", "v", "tau")


def test_signals_written_at_times_of_their_own(data, arm, tmp_path):
    """Torques come half a sample after positions: what is joined to them lies between two of these."""
    rows = [(name, joint, values) for name, joint, values in _rows(data) if name != "velocity"]
    late = [0.0 if name == "position" else 0.005 for name, _, _ in rows]
    columns = {
        "t": np.concatenate([data["time"] + shift for shift in late]),
        "name": np.repeat([f"{joint}/{name}" for name, joint, _ in rows], 600).tolist(),
        "value": np.concatenate([values for _, _, values in rows]),
    }
    found = excite.convert([table(tmp_path / "a.csv", columns)], arm, tmp_path / "log", WHOLE)
    (trial,) = found.log.trials
    for k in range(3):
        expected = np.interp(trial.time, data["time"], data["q"][:, k])
        assert np.abs(trial.q[:, k] - expected).max() < 0.03
        assert np.std(trial.tau[:, k]) == pytest.approx(np.std(data["tau"][:, k]), rel=0.02)
