"""Recordings as other programs write them: nested tables, numpy in cells."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pyarrow as pa
import pyarrow.parquet
import pytest
from scipy.io import savemat

import excite
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import UnclearError
from excite.conversion.recording import load_machine
from excite.doctor.examine import examine
from excite.errors import LogError
from tests.conversion import written
from tests.conversion.test_written_otherwise import N, holds, table, whole
from tests.conversion.written import JOINTS

pytestmark = pytest.mark.usefixtures("readers_here")


@pytest.fixture(scope="module")
def data() -> dict[str, np.ndarray]:
    return written.motion(N)


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written.arm_urdf(tmp_path_factory.mktemp("arm") / "arm.urdf")


def test_records_in_the_columns_of_parquet(data, arm, tmp_path):
    rows = [
        {"stamp": float(t), "state": {"position": q.tolist(), "effort": tau.tolist()}}
        for t, q, tau in zip(data["time"], data["q"], data["tau"], strict=True)
    ]
    pa.parquet.write_table(pa.Table.from_pylist(rows), tmp_path / "a.parquet")
    holds(whole(tmp_path / "a.parquet", arm, tmp_path), data)


def test_a_recording_without_any_number_is_refused(arm, tmp_path):
    """Numpy says nothing of it."""
    nothing = np.full((N, 3), np.nan)
    pa.parquet.write_table(
        pa.table({f"q.{joint}": nothing[:, k] for k, joint in enumerate(JOINTS)}), tmp_path / "a.parquet"
    )
    with pytest.raises(LogError, match="holds no columns of numbers"):
        excite.convert([tmp_path / "a.parquet"], arm, tmp_path / "log")


def test_a_list_of_records_a_row_whose_order_changes(data, arm, tmp_path):
    rng = np.random.default_rng(0)
    rows = [
        {
            "t_ns": int(1e9 * t),
            "joints": [
                {"name": JOINTS[k], "pos": float(q[k]), "trq": float(tau[k])} for k in rng.permutation(3)
            ],
        }
        for t, q, tau in zip(data["time"], data["q"], data["tau"], strict=True)
    ]
    pa.parquet.write_table(pa.Table.from_pylist(rows), tmp_path / "a.parquet")
    holds(whole(tmp_path / "a.parquet", arm, tmp_path), data)


def test_messages_of_joint_states_in_lines_of_json_whose_order_changes(data, arm, tmp_path):
    rng = np.random.default_rng(1)
    lines = []
    for t, q, tau in zip(data["time"], data["q"], data["tau"], strict=True):
        order = rng.permutation(3)
        message = {
            "name": [JOINTS[k] for k in order],
            "position": q[order].tolist(),
            "effort": tau[order].tolist(),
        }
        lines.append(json.dumps({"stamp": t} | message))
    (tmp_path / "a.jsonl").write_text("\n".join(lines))
    holds(whole(tmp_path / "a.jsonl", arm, tmp_path), data)


def test_numbers_in_cells_as_numpy_writes_them(data, arm, tmp_path):
    lines = ["t,q,tau"]
    for t, q, tau in zip(data["time"], data["q"], data["tau"], strict=True):
        cells = (", ".join(f"np.float64({value:.9f})" for value in row) for row in (q, tau))
        lines.append(f'{t},"[{next(cells)}]","[{next(cells)}]"')
    (tmp_path / "a.csv").write_text("\n".join(lines))
    holds(whole(tmp_path / "a.csv", arm, tmp_path), data)


def test_decimal_commas_in_quotation_marks_between_commas(data, arm, tmp_path):
    names = ["t", *(f"q{k}" for k in range(3)), *(f"tau{k}" for k in range(3))]
    rows = np.column_stack([data["time"], data["q"], data["tau"]])
    lines = [",".join('"' + f"{value:.8f}".replace(".", ",") + '"' for value in row) for row in rows]
    (tmp_path / "a.csv").write_text("\n".join([",".join(names), *lines]))
    holds(whole(tmp_path / "a.csv", arm, tmp_path), data)


def test_words_in_another_script_with_units(data, arm, tmp_path):
    names = ["時刻[s]", *(f"J{k + 1}位置[deg]" for k in range(3)), *(f"J{k + 1}トルク[Nm]" for k in range(3))]
    rows = np.column_stack([data["time"], np.degrees(data["q"]), data["tau"]])
    lines = [",".join(names), *(",".join(f"{value:.8f}" for value in row) for row in rows)]
    (tmp_path / "a.csv").write_bytes("\n".join(lines).encode("cp932"))
    holds(whole(tmp_path / "a.csv", arm, tmp_path), data)


def test_a_counter_of_any_name_is_no_clock(data, arm, tmp_path):
    """Protocols count their messages: 250 a second would be taken for a thousand."""
    names = ["seqno", "tm", *(f"joints[{k}]" for k in range(3)), *(f"tau[{k}]" for k in range(3))]
    count = np.arange(N) + 1000.0
    file = table(tmp_path / "a.csv", names, count, 1e3 * data["time"], data["q"], data["tau"])
    holds(whole(file, arm, tmp_path), data)
    file = table(tmp_path / "b.csv", ["seqno", *names[2:]], count, data["q"], data["tau"])
    with pytest.raises(UnclearError, match="no column of times"):
        whole(file, arm, tmp_path)


def test_what_comes_in_and_goes_out_of_a_controller(data, arm, tmp_path):
    """mc_rtc calls what the robot measures in, and what it is sent out."""
    names = ["t", *(f"{word}_{k}" for word in ("qIn", "qOut", "alphaIn", "tauIn") for k in range(3))]
    columns = (data["q"], data["q_cmd"], data["v"], data["tau"])
    found = whole(table(tmp_path / "a.csv", names, data["time"], *columns), arm, tmp_path)
    holds(found, data)
    np.testing.assert_allclose(found.log.trials[0].q_cmd, data["q_cmd"], atol=1e-6)
    np.testing.assert_allclose(found.log.trials[0].v, data["v"], atol=1e-6)


@pytest.mark.parametrize(("of", "channel"), [("tau", "tau_cmd"), ("q_cmd", "q_cmd"), ("noise", None)])
def test_controls_are_of_what_follows_them(of, channel, data, arm, tmp_path):
    """A simulator's ``ctrl`` is a torque of motors and a position of servos."""
    control = np.random.default_rng(0).standard_normal(data["q"].shape) if of == "noise" else data[of]
    names = [f"{word}[{k}]" for word in ("qpos", "qfrc_actuator", "ctrl") for k in range(3)]
    file = table(tmp_path / "a.csv", ["time", *names], data["time"], data["q"], data["tau"], control)
    trial = whole(file, arm, tmp_path).log.trials[0]
    assert {c for c in ("q_cmd", "tau_cmd") if getattr(trial, c) is not None} == (
        {channel} if channel else set()
    )


def test_targets_alone_are_nothing_measured(data, arm, tmp_path):
    names = ["timestamp", *(f"target_{word}_{k}" for word in ("q", "moment") for k in range(3))]
    file = table(tmp_path / "a.csv", names, data["time"], data["q"], data["tau"])
    with pytest.raises(UnclearError, match="nothing that was measured"):
        whole(file, arm, tmp_path)
    stated = {"columns": {"q": "target_q_{n0}", "tau": "target_moment_{n0}"}}
    holds(whole(file, arm, tmp_path, **stated), data)


def test_two_machines_in_one_table_are_asked_for_by_name(data, arm, tmp_path):
    names = [
        "t",
        *(f"{side}_{word}_{k}" for side in ("left", "right") for word in ("q", "tau") for k in range(3)),
    ]
    columns = (data["q"], data["tau"], -data["q"], -data["tau"])
    file = table(tmp_path / "a.csv", names, data["time"], *columns)
    with pytest.raises(UnclearError, match=r"left_q_0 … or right_q_0 …"):
        whole(file, arm, tmp_path)
    holds(whole(file, arm, tmp_path, columns={"q": "left_q_{n0}", "tau": "left_tau_{n0}"}), data)


def test_a_share_of_what_is_rated_is_a_unit(data, arm, tmp_path):
    names = ["t", *(f"J{k + 1} Pos[deg]" for k in range(3)), *(f"J{k + 1} Torque[%]" for k in range(3))]
    file = table(tmp_path / "a.csv", names, data["time"], np.degrees(data["q"]), data["tau"])
    with pytest.raises(UnclearError, match="a share of a rated torque"):
        excite.convert([file], arm, tmp_path / "log", Map())


def test_a_joint_that_turns_on_and_on_leaves_the_others_their_ranges(data, tmp_path):
    """Angles in degrees within a turn, as Kortex has them; the model's first joint has no ends."""
    robot = written.arm_urdf(tmp_path / "arm.urdf")
    first = 'name="shoulder" type="revolute"'
    assert first in robot.read_text()
    text = robot.read_text().replace(first, 'name="shoulder" type="continuous"')
    robot.write_text(text.replace('lower="-2.5" upper="2.5" ', "", 1))
    machine = load_machine(robot)
    np.testing.assert_array_equal(machine.lower, [-np.inf, -2.5, -2.5])
    names = ["t", *(f"{word}_{k}" for word in ("position", "torque") for k in range(3))]
    file = table(tmp_path / "a.csv", names, data["time"], np.degrees(data["q"]) % 360.0, data["tau"])
    found = whole(file, robot, tmp_path)
    turns = np.round((found.log.trials[0].q - data["q"]) / (2.0 * np.pi))
    np.testing.assert_allclose(found.log.trials[0].q - 2.0 * np.pi * turns, data["q"], atol=1e-5)
    assert found.chart is not None and "beyond_limits" not in {item.kind for item in found.chart.findings}


def test_a_legged_robot_that_a_stand_holds_is_looked_at_by_its_own_name(tmp_path):
    """The command that convert proposes names the robot, whose own description stands on its feet."""
    robot = excite.load_robot("go2")
    rng = np.random.default_rng(0)
    time = np.arange(0.0, 12.0, 0.005)
    waves = rng.uniform(1.0, 6.0, robot.n_joints)
    joints = robot.rest[7:] + 0.2 * np.sin(np.outer(time, waves))
    model = robot.model
    data = model.createData()
    q = np.hstack([np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(time), 1)), joints])
    v = np.hstack([np.zeros((len(time), 6)), np.gradient(joints, time, axis=0)])
    a = np.gradient(v, time, axis=0)
    tau = np.array([pin.rnea(model, data, *row)[6:] for row in zip(q, v, a, strict=True)])
    names = ["t", *(f"{word}.{joint}" for word in ("q", "tau") for joint in robot.joint_names)]
    file = table(tmp_path / "a.csv", names, time, joints, tau)
    rules = {"trials": {"split": "none", "validation": ["none"]}, "log": {"base": "held"}}
    found = excite.convert([file], "go2", tmp_path / "log", Map.model_validate(rules))
    named = excite.robot_for_log("go2", found.folder)
    assert not named.floating and named.joint_names == robot.joint_names
    chart = examine(named, found.log)
    assert chart.usable and "torque_scale" not in {item.kind for item in chart.findings}


def test_levels_of_headings_and_names_that_stand_three_times(data, arm, tmp_path):
    body = "\n".join(
        ",".join(f"{value:.8f}" for value in row)
        for row in np.column_stack([data["time"], data["q"], data["tau"]])
    )
    levels = [",".join(["", *["pos"] * 3, *["trq"] * 3]), ",".join(["", *JOINTS, *JOINTS]), "time" + "," * 6]
    (tmp_path / "levels.csv").write_text("\n".join([*levels, body]))
    holds(whole(tmp_path / "levels.csv", arm, tmp_path), data)
    (tmp_path / "same.csv").write_text(",".join(["t", *["position"] * 3, *["torque"] * 3]) + "\n" + body)
    holds(whole(tmp_path / "same.csv", arm, tmp_path), data)


def test_commas_between_thousands_in_quotation_marks(data, arm, tmp_path):
    names = [
        "Time (ms)",
        *(f"J{k} Position (deg)" for k in range(3)),
        *(f"J{k} Torque (mNm)" for k in range(3)),
    ]
    rows = np.column_stack([1e3 * data["time"], np.degrees(data["q"]), 1e3 * data["tau"]])
    lines = [",".join(f'"{value:,.4f}"' for value in row) for row in rows]
    (tmp_path / "a.csv").write_text("\n".join([",".join(names), *lines]))
    holds(whole(tmp_path / "a.csv", arm, tmp_path), data)


def test_a_model_is_no_recording(arm, tmp_path):
    (tmp_path / "arm.xml").write_text(arm.read_text())
    with pytest.raises(LogError, match="is XML, in which robots' models are written"):
        whole(tmp_path / "arm.xml", arm, tmp_path)


def test_currents_in_counts_of_a_servo_are_called_so(data, arm, tmp_path):
    names = ["t", *(f"q{k}" for k in range(3)), *(f"Present_Current_{k}" for k in range(3))]
    file = table(tmp_path / "a.csv", names, data["time"], data["q"], np.round(data["tau"] / 2.69e-3))
    found = whole(file, arm, tmp_path)
    assert any("counts of a drive" in because for _, _, because in found.guesses)


def test_times_in_a_file_of_their_own(data, arm, tmp_path):
    """As MATLAB saves a variable a file."""
    for name, key in (("t", "time"), ("q", "q"), ("qDot", "v"), ("tau", "tau")):
        savemat(tmp_path / f"{name}.mat", {name: data[key]})
    files = [tmp_path / f"{name}.mat" for name in ("q", "qDot", "t", "tau")]
    done = excite.convert(files, arm, tmp_path / "log", written.WHOLE)
    np.testing.assert_allclose(done.log.trials[0].q, data["q"], atol=1e-9)
    np.testing.assert_allclose(done.log.trials[0].v, data["v"], atol=1e-9)
    np.testing.assert_allclose(done.log.trials[0].tau, data["tau"], atol=1e-9)


def test_whole_arrays_in_a_line_of_a_controllers_program(arm, tmp_path):
    """TwinCAT's declarations are no recording, and are said to be none."""
    zeros = ", ".join(["0.000000"] * 20_000)
    text = "data_sample_time : LREAL := 0.0008; \n" + "".join(
        f"phi_r_{k} : ARRAY[1..20000] OF REAL := [{zeros}]; \n" for k in (1, 2, 3)
    )
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(LogError):
        excite.convert([tmp_path / "a.txt"], arm, tmp_path / "log")


def test_trials_with_a_folder_each_are_called_after_it(arm, tmp_path):
    """The parts of each are one, whatever folder lies between."""
    for k, day in enumerate(("monday/first", "monday/second", "tuesday")):
        motion = written.motion(N, seed=k)
        folder = tmp_path / "runs" / day
        folder.mkdir(parents=True)
        for name, key, file in (("q", "q", "where.csv"), ("tau", "tau", "torques.csv")):
            names = ["time", *(f"{name}{j}" for j in (1, 2, 3))]
            table(folder / file, names, motion["time"], motion[key])
    done = excite.convert([tmp_path / "runs"], arm, tmp_path / "log", written.WHOLE)
    assert [trial.name for trial in done.log.trials] == ["monday_first", "monday_second", "tuesday"]
    for k, trial in enumerate(done.log.trials):
        np.testing.assert_allclose(trial.q, written.motion(N, seed=k)["q"], atol=1e-6)
        assert trial.tau is not None
    (tmp_path / "none" / "below").mkdir(parents=True)
    with pytest.raises(LogError, match="holds no recordings"):
        excite.convert([tmp_path / "none"], arm, tmp_path / "other")


def test_what_is_wrong_with_many_files_alike_is_said_once(arm, tmp_path):
    for name in ("a.csv", "b.csv", "c.csv"):
        (tmp_path / name).write_bytes(b"")
    files = [str(tmp_path / name) for name in ("a.csv", "b.csv", "c.csv")]
    with pytest.raises(LogError) as alone:
        excite.convert(files[0], arm, tmp_path / "one")
    with pytest.raises(LogError) as together:
        excite.convert(files, arm, tmp_path / "all")
    assert together.value.what == alone.value.what and together.value.remedy == alone.value.remedy
    assert together.value.source == f"{files[0]} and 2 more"
    with pytest.raises(LogError) as different:
        excite.convert([*files, str(tmp_path / "gone.csv")], arm, tmp_path / "all")
    said = str(different.value)
    assert said.count(alone.value.what) == 1 and "gone.csv: no such file" in said
