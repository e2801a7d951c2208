"""Positions of joints that slide are lengths, whatever the unit of the angles beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import excite
from excite.conversion.columns.words import read_clue
from excite.conversion.explicit_mapping import Map
from excite.errors import ExciteError
from tests.conversion import written
from tests.conversion.test_guesses import named, table
from tests.conversion.written import JOINTS

pytestmark = pytest.mark.usefixtures("unexamined")

LIFT = JOINTS[0]


def lifted(folder: Path) -> Path:
    """The arm on a lift of 0.4 m in place of its first joint."""
    path = written.arm_urdf(folder / "arm.urdf")
    first, rest = path.read_text().split("</joint>", 1)
    first = first.replace('type="revolute"', 'type="prismatic"').replace(
        'axis xyz="0 1 0"', 'axis xyz="0 0 1"'
    )
    limits = 'lower="0" upper="0.4" effort="600"'
    path.write_text(first.replace('lower="-2.5" upper="2.5" effort="60"', limits) + "</joint>" + rest)
    return path


def lift_motion() -> dict[str, np.ndarray]:
    """A motion that keeps the lift in its range [rad and m]."""
    data = written.motion(1200)
    size = 0.15 / np.abs(data["q"][:, 0]).max()
    data["q"][:, 0] = 0.2 + size * data["q"][:, 0]
    data["v"][:, 0] *= size
    data["q_cmd"] = data["q"] + 0.01 * data["v"]
    return data


@pytest.mark.parametrize("length", [1.0, 1e3], ids=["metres", "millimetres"])
def test_degrees_beside_a_lift_are_of_the_joints_that_turn(length, tmp_path):
    arm, data = lifted(tmp_path), lift_motion()
    units = np.array([length, *np.degrees([1.0, 1.0])])
    logged = data | {name: data[name] * units for name in ("q", "v", "q_cmd")}
    file = table(
        tmp_path / "run.csv",
        {"t": data["time"]} | named(logged, q="pos{n}", v="vel{n}", q_cmd="pos_cmd{n}", tau="eff{n}"),
    )
    found = excite.convert([file], arm, tmp_path / "log")
    again = excite.convert([file], arm, tmp_path / "again", tmp_path / "log" / "map.yaml")
    for log in (found.log, again.log):
        q, v = (np.concatenate([getattr(trial, name) for trial in log.trials]) for name in ("q", "v"))
        np.testing.assert_allclose(q, data["q"], atol=1e-6)
        np.testing.assert_allclose(v, data["v"], atol=1e-6)
        q_cmd = np.concatenate([trial.q_cmd for trial in log.trials])
        np.testing.assert_allclose(q_cmd, data["q_cmd"], atol=1e-6)


def test_degrees_that_a_map_states_of_all_are_none_of_a_lift(tmp_path):
    arm, data = lifted(tmp_path), lift_motion()
    logged = data | {"q": data["q"] * np.array([1.0, *np.degrees([1.0, 1.0])])}
    file = table(tmp_path / "run.csv", {"t": data["time"]} | named(logged, q="pos{n}", tau="eff{n}"))
    found = written.whole(file, arm, tmp_path, units={"q": "deg"})
    np.testing.assert_allclose(found.log.trials[0].q, data["q"], atol=1e-6)


def test_the_unit_that_a_map_states_of_the_lift_is_believed(tmp_path):
    arm, data = lifted(tmp_path), lift_motion()
    logged = data | {"q": data["q"] * np.array([100.0, *np.degrees([1.0, 1.0])])}
    file = table(tmp_path / "run.csv", {"t": data["time"]} | named(logged, q="pos{n}", tau="eff{n}"))
    units = Map.model_validate({"units": {"q": "deg", f"q.{LIFT}": "in"}}).units
    found = written.whole(file, arm, tmp_path, units=units)
    np.testing.assert_allclose(found.log.trials[0].q[:, 0], 2.54 * data["q"][:, 0], atol=1e-6)


def test_a_force_of_the_lift_stands_beside_torques_of_joints_called_in_words(tmp_path):
    arm, data = lifted(tmp_path), lift_motion()
    arm.write_text(arm.read_text().replace('"elbow"', '"elbow_pitch"'))
    columns = {"Timestamp (ms)": 1e3 * data["time"]}
    for k, (name, force, length) in enumerate(
        (
            ("Shoulder", "Force (N)", "mm"),
            ("Elbow Pitch", "Torque (Nm)", "deg"),
            ("Wrist", "Torque (Nm)", "deg"),
        )
    ):
        unit = {"mm": 1e3, "deg": np.degrees(1.0)}[length]
        columns[f"{name} Pos ({length})"] = unit * data["q"][:, k]
        columns[f"{name} {force}"] = data["tau"][:, k]
    found = written.whole(table(tmp_path / "run.csv", columns), arm, tmp_path)
    assert found.log.header.no_torque == ()
    np.testing.assert_allclose(found.log.trials[0].q, data["q"], atol=1e-6)
    np.testing.assert_allclose(found.log.trials[0].tau, data["tau"], atol=1e-6)


@pytest.mark.parametrize(
    "name", ["Left Elbow Torque", "LeftElbowTorque", "left-elbow torque", "LEFT_ELBOW/torque"]
)
def test_words_of_a_joints_name_are_parted_in_any_way(name):
    assert read_clue(name, ["left_elbow", "elbow"]).exact == "left_elbow"


def test_numbers_of_a_joints_name_are_as_they_are_written():
    # Another program counts from another number.
    assert read_clue("joint 1 pos", ["joint_1", "joint_2"]).exact == ""


def test_joints_whose_torque_was_not_found_are_named(tmp_path):
    arm, data = lifted(tmp_path), lift_motion()
    columns = {"t": data["time"]} | {f"pos{k + 1}": data["q"][:, k] for k in range(3)}
    columns |= {f"eff{k + 1}": data["tau"][:, k] for k in (0, 2)}
    found = written.whole(table(tmp_path / "run.csv", columns), arm, tmp_path)
    assert found.log.header.no_torque == ("elbow",)
    assert any(
        note.startswith("no torque of elbow: if it was recorded, columns: {tau.elbow") for note in found.notes
    )


def test_a_force_of_the_lift_and_torques_of_the_others_are_one_channel(tmp_path):
    """A lift has a force and what turns a torque; the one that is alone in its family is no other signal."""
    arm, data = lifted(tmp_path), lift_motion()
    columns = {"t": data["time"]}
    for k, joint in enumerate(JOINTS):
        columns[f"{joint}_pos"] = data["q"][:, k]
        columns[f"{joint}_force_N" if joint == LIFT else f"{joint}_torque_Nm"] = data["tau"][:, k]
    found = excite.convert([table(tmp_path / "run.csv", columns)], arm, tmp_path / "log")
    assert found.log.header.no_torque == ()
    tau = np.concatenate([trial.tau for trial in found.log.trials])
    np.testing.assert_allclose(tau, data["tau"], atol=1e-6)


def test_a_second_signal_of_some_joints_takes_no_place_of_another(tmp_path):
    """Torques that two joints have twice are still asked about or left out, not mixed."""
    arm, data = lifted(tmp_path), lift_motion()
    columns = {"t": data["time"]}
    for k, joint in enumerate(JOINTS):
        columns[f"{joint}_pos"], columns[f"{joint}_torque"] = data["q"][:, k], data["tau"][:, k]
    columns[f"{JOINTS[1]}_force"] = 3.0 * data["tau"][:, 1]
    found = excite.convert([table(tmp_path / "run.csv", columns)], arm, tmp_path / "log")
    tau = np.concatenate([trial.tau for trial in found.log.trials])
    np.testing.assert_allclose(tau, data["tau"], atol=1e-6)


@pytest.mark.parametrize(("unit", "line"), [("mm", "deg"), ("deg", "mm")])
def test_a_unit_that_joints_cannot_have_is_asked_about(unit, line, tmp_path):
    arm, data = lifted(tmp_path), lift_motion()
    columns = named(data, q=f"pos{{n}}_{unit}", tau="torque{n}")
    file = table(tmp_path / "run.csv", {"time_s": data["time"]} | columns)
    with pytest.raises(ExciteError, match=f"say {unit}.*units: .*: {line}"):
        excite.convert([file], arm, tmp_path / "log")


def test_a_joints_name_with_a_unit_of_velocity_is_one():
    said = read_clue("haa_dps", ["haa", "hfe"])
    assert (said.quantity, said.unit) == ("v", "deg/s")
