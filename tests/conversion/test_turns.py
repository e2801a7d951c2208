"""Angles that drivers count from 0 to 360 degrees come back into the joints' ranges, in every recording."""

from __future__ import annotations

import numpy as np
import pytest

import excite
from tests.conversion import written
from tests.conversion.test_guesses import named, table
from tests.conversion.written import JOINTS


def test_each_recording_has_its_own_whole_turns(tmp_path):
    """One begins at 359 degrees and goes on, the next at 1, a third never crosses the seam."""
    arm = written.arm_urdf(tmp_path / "arm.urdf")
    truth = []
    for k, zero in enumerate((-0.02, 0.02, -0.6)):
        data = written.motion()
        size = 0.8 if k < 2 else 0.3
        q = zero + size * (data["q"] - data["q"][0]) / np.abs(data["q"] - data["q"][0]).max()
        truth.append(q)
        data["q"] = np.degrees(q) % 360.0
        table(tmp_path / f"r{k}.csv", {"time": data["time"]} | named(data, q="pos_deg_{n}", tau="tau{n}"))
    files = [tmp_path / f"r{k}.csv" for k in range(3)]
    found = excite.convert(files, arm, tmp_path / "log")
    assert found.log.header.joints == JOINTS
    assert [f for f in found.chart.findings if f.kind == "degrees"] == []
    assert any("whole turns" in note or "whole turn" in note for note in found.notes)
    for trial, q in zip(found.log.trials, truth, strict=True):
        np.testing.assert_allclose(trial.q.mean(axis=0), q.mean(axis=0), atol=0.1)


def test_stamps_of_few_digits_leave_velocities_the_derivative(tmp_path):
    arm = written.arm_urdf(tmp_path / "arm.urdf")
    data = written.motion()
    rough = {"time": np.floor(50.0 * data["time"]) / 50.0}
    file = table(tmp_path / "a.csv", rough | named(data, q="q{n}", v="v{n}", tau="tau{n}"))
    said = [
        b for what, _, b in excite.convert([file], arm, tmp_path / "log").guesses if what.startswith("v (")
    ]
    assert said and "derivative" in said[0] and "differ" not in said[0]


@pytest.mark.parametrize(("actual", "setpoint"), [("AIPos.A{n}", "ASPos.A{n}")])
def test_actual_and_set_positions_of_a_controller(actual, setpoint, tmp_path):
    arm = written.arm_urdf(tmp_path / "arm.urdf")
    data = written.motion()
    data["set"] = data["q"] + 0.001
    columns = named(data, q=actual, set=setpoint, tau="GearTorque.A{n}")
    file = table(tmp_path / "rsi.csv", {"IPOC": 4208163634 + 1000.0 * data["time"]} | columns)
    found = excite.convert([file], arm, tmp_path / "log")
    assert found.columns["time"] == ("IPOC", 1e-3)
    assert [found.columns[f"{c}.elbow"][0] for c in ("q", "q_cmd", "tau")] == [
        "AIPos.A2",
        "ASPos.A2",
        "GearTorque.A2",
    ]
