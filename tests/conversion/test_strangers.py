"""Habits of recordings of strangers: names in capitals, forces of feet, pointers, rows of one quantity."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import excite
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import UnclearError
from excite.errors import LogError
from excite.export.models.verification import random_states, read_urdf_text
from excite.logs.robot import nominal_robot
from tests.conversion import written
from tests.conversion.test_habits import check, columns_of, table
from tests.conversion.written import JOINTS, WHOLE


def leg(path: Path, sides: tuple[str, ...] = ("FR", "RL")) -> Path:
    """Two legs of two joints each on one trunk."""
    inertia = 'ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"'
    inertial = f'<inertial><mass value="1"/><inertia {inertia}/></inertial>'
    text = [f'<robot name="legs"><link name="trunk">{inertial}</link>']
    for side in sides:
        above = "trunk"
        for part in ("hip", "calf"):
            text.append(f'<link name="{side}_{part}">{inertial}</link>')
            text.append(
                f'<joint name="{side}_{part}_joint" type="revolute"><parent link="{above}"/>'
                f'<child link="{side}_{part}"/><axis xyz="0 1 0"/>'
                '<limit lower="-3" upper="3" effort="30" velocity="20"/></joint>'
            )
            above = f"{side}_{part}"
    path.write_text("\n".join([*text, "</robot>"]))
    return path


def test_names_that_change_their_case_are_joints_and_forces_of_feet_are_no_torques(tmp_path):
    joints = ["FR_hip", "FR_calf", "RL_hip", "RL_calf"]
    time = np.arange(600) / 100.0
    rng = np.random.default_rng(0)
    columns = {"Time(s)": time, "FR_Force": rng.uniform(0, 170, 600), "RL_Force": rng.uniform(0, 170, 600)}
    columns |= {f"BaseW{axis}": 0.1 * np.sin(time + k) for k, axis in enumerate("xyz")}
    columns |= {f"JointPos{name}": 0.5 * np.sin(2.0 * time + k) for k, name in enumerate(joints)}
    done = excite.convert(
        [table(tmp_path / "a.csv", columns)], leg(tmp_path / "r.urdf"), tmp_path / "log", WHOLE
    )
    assert {t: c for t, (c, _) in done.columns.items() if t.startswith("q.")} == {
        f"q.{name}_joint": f"JointPos{name}" for name in joints
    }
    assert not any(target.startswith("tau.") for target in done.columns)
    assert any(what == "nothing" and "FR_Force" in source for what, source, _ in done.guesses)


def test_joints_that_follow_others_are_not_asked_of_a_recording(data, arm, tmp_path):
    text = arm.read_text().replace('<joint name="wrist" type="revolute">', '<joint name="wrist" type="revolute">'
                                   '<mimic joint="elbow" multiplier="1"/>')  # fmt: skip
    arm.write_text(text)
    file = table(tmp_path / "a.csv", columns_of(data, q="{joint}_pos", tau="{joint}_torque"))
    done = excite.convert([file], arm, tmp_path / "log", WHOLE)
    assert done.log.header.joints == JOINTS[:2] and done.chart is not None


@pytest.mark.parametrize("name", ["a.csv", "a.mat", "a.mcap", "a.bag", "a.npz", "a.parquet", "a.h5"])
def test_a_pointer_of_git_lfs_is_called_so(name, arm, tmp_path):
    (tmp_path / name).write_text(
        f"version https://git-lfs.github.com/spec/v1\noid sha256:{'0' * 64}\nsize 9\n"
    )
    with pytest.raises(LogError, match=r"pointer that Git LFS left.*git lfs pull"):
        excite.convert([tmp_path / name], arm, tmp_path / "log")


def test_one_question_for_all_files_without_a_clock(data, arm, tmp_path):
    columns = {
        key: values for key, values in columns_of(data, q="q{n}", tau="tau{n}").items() if key != "time"
    }
    files = [table(tmp_path / f"run_{k}.csv", columns) for k in range(3)]
    with pytest.raises(UnclearError) as error:
        excite.convert(files, arm, tmp_path / "log")
    assert len(error.value.questions) == 1


def test_degrees_are_not_taken_where_zeros_may_be_elsewhere(data, arm, tmp_path):
    moved = {**data, "q": data["q"] + 3.6}
    file = table(tmp_path / "a.csv", columns_of(moved, q="q{n}"))
    with pytest.raises(UnclearError, match=r"whose zeros are not the model's"):
        excite.convert([file], arm, tmp_path / "log", WHOLE)


def test_a_map_scales_stamps(data, arm, tmp_path):
    file = table(tmp_path / "a.csv", columns_of({**data, "time": data["time"] * 1.8}, q="q{n}", tau="tau{n}"))
    said = Map.model_validate({"scale": {"time": 1.0 / 1.8}, "trials": {"split": "none"}})
    done = excite.convert([file], arm, tmp_path / "log", said)
    assert done.log.header.rate_hz == pytest.approx(written.RATE, rel=1e-3)
    assert excite.convert(
        [file], arm, tmp_path / "again", done.folder / "map.yaml"
    ).log.header.rate_hz == pytest.approx(written.RATE, rel=1e-3)


def _one_in_degrees(data, elbow: int = 1) -> dict[str, np.ndarray]:
    """The motion with one joint's positions in degrees."""
    mixed = data["q"].copy()
    mixed[:, elbow] = np.degrees(mixed[:, elbow])
    return {**data, "q": mixed}


def test_a_column_in_degrees_among_others_is_asked_for(data, arm, tmp_path):
    columns = columns_of(_one_in_degrees(data), q="q{n}", tau="tau{n}")
    with pytest.raises(UnclearError, match=r"q2 can only be degrees, q1, q3 may be radians") as error:
        excite.convert([table(tmp_path / "a.csv", columns)], arm, tmp_path / "log", WHOLE)
    (question,) = error.value.questions
    assert "units: {q.shoulder: rad, q.elbow: deg, q.wrist: rad}" in question.line
    said = WHOLE.model_copy(update={"units": {"q.elbow": "deg", "q.shoulder": "rad", "q.wrist": "rad"}})
    done = excite.convert([tmp_path / "a.csv"], arm, tmp_path / "log", said)
    check(done, data, "q", "tau")
    assert "q.elbow: 0.0174" in (done.folder / "map.yaml").read_text()


def test_units_in_names_may_differ_from_joint_to_joint(data, arm, tmp_path):
    columns = columns_of(_one_in_degrees(data), q="q{n}", tau="tau{n}")
    named = {
        name + {"q1": " [rad]", "q2": " [deg]", "q3": " [rad]"}.get(name, ""): x
        for name, x in columns.items()
    }
    check(excite.convert([table(tmp_path / "a.csv", named)], arm, tmp_path / "log", WHOLE), data, "q", "tau")


def test_degrees_of_all_joints_are_not_asked_for_where_some_hold_still(data, arm, tmp_path):
    held = {**data, "q": np.degrees(data["q"])}
    held["q"][:, 2] = 1.3 + 0.02 * np.sin(3.0 * data["time"])
    file = table(tmp_path / "a.csv", columns_of(held, q="q{n}", tau="tau{n}"))
    done = excite.convert([file], arm, tmp_path / "log", WHOLE)
    check(done, {**data, "q": np.radians(held["q"])}, "q")


def test_limits_without_effort_are_no_reason_to_refuse_a_model(data, arm, tmp_path):
    """Koch's and other small arms' files state none, which the parser of ROS refuses."""
    arm.write_text(arm.read_text().replace(' effort="60"', ""))
    file = table(tmp_path / "a.csv", columns_of(data, q="q{n}", tau="tau{n}"))
    done = excite.convert([file], arm, tmp_path / "log", WHOLE)
    check(done, data, "q", "tau")
    robot = nominal_robot(done.log)
    states = random_states(robot, robot.nominal_parameters)
    assert states.error(read_urdf_text(robot, arm.read_bytes(), states).torques) < 1e-9
