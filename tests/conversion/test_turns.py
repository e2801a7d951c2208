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


# What a turn is in each unit, and the numbers between which its driver keeps an angle.
WRAPPED = {
    "counts/4096": (4096.0, 0.0),
    "rev": (1.0, 0.0),
    "deg": (360.0, -180.0),
    "rad": (2.0 * np.pi, 0.0),
    "mrad": (2000.0 * np.pi, -1000.0 * np.pi),
}


@pytest.mark.parametrize("unit", WRAPPED)
@pytest.mark.parametrize("turned", [0, 1])
def test_a_counter_that_passes_its_end_inside_the_travel_goes_on(turned, unit, tmp_path):
    """Of one joint or the other; its commands pass it some rows earlier and stay on the joint's turn."""
    arm = written.arm_urdf(tmp_path / "arm.urdf")
    data = written.motion()
    turn, low = WRAPPED[unit]
    middle = np.median(data["q"][:, turned])

    def kept(q: np.ndarray) -> np.ndarray:
        numbers = q / (2.0 * np.pi) * turn
        # The seam stands in the middle of the joint's way, that of the others far from theirs.
        numbers[:, turned] = low + (numbers[:, turned] - middle / (2.0 * np.pi) * turn) % turn
        return np.floor(numbers) if unit.startswith("counts") else numbers

    data_kept = {**data, "q": kept(data["q"]), "q_cmd": kept(data["q_cmd"])}
    columns = named(data_kept, q="q{n}", q_cmd="q_cmd{n}", tau="tau{n}")
    file = table(tmp_path / "a.csv", {"time": data["time"]} | columns)
    found = written.whole(file, arm, tmp_path, units={"q": unit, "q_cmd": unit})
    assert any("goes on here" in note for note in found.notes)
    assert not {"steps", "whole_turns", "degrees"} & {item.kind for item in found.chart.findings}
    trial = found.log.trials[0]
    moved = trial.q - trial.q[0]
    np.testing.assert_allclose(moved, (data["q"] - data["q"][0])[: len(moved)], atol=0.01)
    assert np.abs(trial.q_cmd - trial.q).max() < 0.2


def test_numbers_that_leap_between_two_states_are_no_turns(tmp_path):
    """A flag, a quaternion that turns its sign, a friction torque of about a newton metre each way."""
    arm = written.arm_urdf(tmp_path / "arm.urdf")
    data = written.motion()
    wave = np.sin(3.0 * data["time"])
    rubbing = 0.499 * np.sign(wave) + 0.001 * wave
    beside = {"flag": (wave > 0).astype(float), "state": 3.0 * (wave > 0), "tau_x": rubbing}
    file = table(tmp_path / "a.csv", {"time": data["time"]} | named(data, q="q{n}", tau="tau{n}") | beside)
    found = written.whole(file, arm, tmp_path)
    assert not any("goes on here" in note for note in found.notes)
    # A torque of no number beside one of each joint is none of theirs.
    torques = {target: source for target, (source, _) in found.columns.items() if target.startswith("tau")}
    assert torques == {f"tau.{joint}": f"tau{k}" for k, joint in enumerate(JOINTS, 1)}


@pytest.mark.parametrize("counts", [16384, 20000, 65536])
def test_counts_of_any_number_a_turn_go_on_behind_their_end(counts, tmp_path):
    """Absolute encoders whose count passes its end inside the travel of two joints."""
    arm = written.arm_urdf(tmp_path / "arm.urdf")
    data = written.motion()
    truth = data["q"] - data["q"].mean(axis=0)
    data["q"] = np.round(truth / (2.0 * np.pi) * counts) % counts
    file = table(tmp_path / "a.csv", {"time": data["time"]} | named(data, q="raw_position_{n}", tau="tau{n}"))
    stated = excite.conversion.explicit_mapping.Map.model_validate({"units": {"q": f"counts/{counts}"}})
    found = excite.convert([file], arm, tmp_path / "log", stated)
    q = np.concatenate([trial.q for trial in found.chart.log.trials])
    assert np.ptp(q, axis=0) == pytest.approx(np.ptp(truth, axis=0), abs=1e-3)
