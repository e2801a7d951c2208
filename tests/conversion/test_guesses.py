"""What is guessed is said, what cannot be told is asked for, all at once, with the line that settles it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

import excite
from excite.conversion.explicit_mapping import Map, read_map
from excite.conversion.guesses import UnclearError
from excite.errors import LogError
from tests.conversion import written
from tests.conversion.written import JOINTS
from tests.reproduction.recordings import example_robot_data

pytestmark = pytest.mark.usefixtures("readers_here")


def table(file: Path, columns: dict[str, np.ndarray]) -> Path:
    rows = np.column_stack(list(columns.values()))
    file.write_text("\n".join([",".join(columns), *(",".join(f"{x:.10g}" for x in row) for row in rows)]))
    return file


def named(data: dict[str, np.ndarray], **patterns: str) -> dict[str, np.ndarray]:
    return {
        pattern.format(n=k + 1): data[kind][:, k]
        for kind, pattern in patterns.items()
        for k in range(len(JOINTS))
    }


def test_degrees_and_milliseconds_are_seen_and_said(arm, tmp_path):
    data = written.motion()
    data["q"] = np.degrees(data["q"])
    data["v"] = np.degrees(data["v"])
    file = table(
        tmp_path / "a.csv", {"stamp": 1000.0 * data["time"]} | named(data, q="p{n}", v="w{n}", tau="t{n}")
    )
    found = excite.convert([file], arm, tmp_path / "log")
    assert found.columns["time"] == ("stamp", 1e-3)
    assert found.columns["q.elbow"] == ("p2", pytest.approx(np.pi / 180.0))
    assert found.columns["v.elbow"] == ("w2", pytest.approx(np.pi / 180.0))
    said = yaml.safe_load((tmp_path / "log" / "log.yaml").read_text())["guessed"]
    assert any(row["what"].startswith("q (3)") and "deg" in row["because"] for row in said)


def test_columns_without_names_are_asked_about_and_a_map_settles_them(arm, tmp_path):
    data = written.motion()
    rows = np.column_stack([data["time"], data["q"], data["v"], data["tau"]])
    np.savetxt(tmp_path / "plain.txt", rows)
    with pytest.raises(UnclearError, match="no columns of joint positions") as error:
        excite.convert([tmp_path / "plain.txt"], arm, tmp_path / "log")
    assert "column2" in str(error.value)
    expected = {
        f"{channel}.{joint}": f"column{2 + 3 * c + k}"
        for c, channel in enumerate(("q", "v", "tau"))
        for k, joint in enumerate(JOINTS)
    }
    found = excite.convert([tmp_path / "plain.txt"], arm, tmp_path / "log", Map(columns=expected))
    columns = {target: source for target, (source, _) in found.columns.items()}
    assert columns == {"time": "column1"} | expected


def test_all_questions_come_at_once_each_with_its_line(arm, tmp_path):
    data = written.motion()
    columns = named({"q": data["q"] * 50.0, "u": data["tau"]}, q="motor_pos_{n}", u="pwm_{n}")
    with pytest.raises(UnclearError) as error:
        excite.convert([table(tmp_path / "a.csv", columns)], arm, tmp_path / "log")
    text = str(error.value)
    assert "\n" not in text
    assert len(error.value.questions) >= 2
    assert all(question.line in text for question in error.value.questions)
    assert "rate_hz" in text and "pwm_1" in text
    assert not (tmp_path / "log").exists()


def test_a_map_settles_what_was_asked(arm, tmp_path):
    data = written.motion()
    gears = np.array([[50.0, 0.0, 0.0], [0.0, -30.0, 0.0], [0.0, 20.0, 40.0]])
    turned = {"q": data["q"] @ gears.T, "tau": data["tau"] @ np.linalg.inv(gears)}
    file = table(
        tmp_path / "a.csv", {"t": data["time"]} | named(turned, q="motor_pos_{n}", tau="motor_tau_{n}")
    )
    mapping = tmp_path / "map.yaml"
    mapping.write_text(f"motors: {gears.tolist()}\ntrials: {{validation: [none]}}\n")
    trial = excite.convert([file], arm, tmp_path / "log", mapping).log.trials[0]
    np.testing.assert_allclose(trial.q, data["q"], atol=1e-6)
    np.testing.assert_allclose(trial.tau, data["tau"], atol=1e-6)


def test_streams_of_other_clocks_are_joined_on_the_torques(arm, tmp_path):
    """Positions slow, efforts fast: two topics of one bag."""
    from rosbags.rosbag2 import Writer

    data = written.motion()
    store = written.ros2_store()
    with Writer(tmp_path / "bag", version=9) as bag:
        kind = "sensor_msgs/msg/JointState"
        slow = bag.add_connection("/encoders", kind, typestore=store)
        fast = bag.add_connection("/drives", kind, typestore=store)
        for i, time in enumerate(data["time"]):
            message = store.types[kind](
                written.stamp(store, 100.0 + time), list(JOINTS), np.zeros(0), np.zeros(0), data["tau"][i]
            )
            bag.write(fast, round((100.0 + time) * 1e9), store.serialize_cdr(message, kind))
            if i % 5 == 0:
                message = store.types[kind](
                    written.stamp(store, 100.0 + time), list(JOINTS), data["q"][i], np.zeros(0), np.zeros(0)
                )
                bag.write(slow, round((100.0 + time) * 1e9), store.serialize_cdr(message, kind))
    found = excite.convert([tmp_path / "bag"], arm, tmp_path / "log", Map(trials={"validation": ["none"]}))
    trial = found.log.trials[0]
    assert len(trial.time) > 0.95 * len(data["time"])
    np.testing.assert_allclose(trial.tau, data["tau"][: len(trial.time)], atol=1e-9)
    np.testing.assert_allclose(trial.q, data["q"][: len(trial.time)], atol=0.02)
    assert any("joined on the times of /drives" in note for note in found.notes)


def test_pauses_part_trials_and_repeats_are_found(arm, tmp_path):
    data = written.motion()
    other = written.motion(seed=5)
    still = 300

    def with_pause(kind: str) -> np.ndarray:
        parts = []
        for piece in (data, other, data):
            window = np.minimum(1.0, np.minimum(np.arange(600), np.arange(600)[::-1]) / 100.0)[:, None]
            parts += [piece[kind] * window if kind == "q" else piece[kind], np.zeros((still, 3))]
        return np.concatenate(parts)

    q, tau = with_pause("q"), with_pause("tau")
    time = np.arange(len(q)) / written.RATE
    file = table(tmp_path / "day.csv", {"t": time} | named({"q": q, "tau": tau}, q="q{n}", tau="tau{n}"))
    trials = excite.convert([file], arm, tmp_path / "log").log.header.trials
    assert [Path(trial.file).stem for trial in trials] == ["day_1", "day_2", "day_3"]
    assert [trial.repeats for trial in trials] == [None, None, "day_1.parquet"]
    assert {trial.role for trial in trials} == {"identification", "validation"}


def test_mistakes_of_a_map_are_said_together(tmp_path):
    (tmp_path / "map.yaml").write_text("colums: {q: a}\nunits: {q: furlong}\nscale: {tau: much}\n")
    with pytest.raises(LogError) as error:
        read_map(tmp_path / "map.yaml")
    assert all(word in str(error.value) for word in ("colums", "units", "scale"))


def test_a_column_of_the_map_that_is_not_there_is_named(arm, tmp_path):
    data = written.motion()
    file = table(tmp_path / "a.csv", {"t": data["time"]} | named(data, q="q{n}"))
    with pytest.raises(UnclearError, match="no column torque_1"):
        excite.convert([file], arm, tmp_path / "log", Map(columns={"tau": "torque_{n}"}))


def test_missing_sources_are_said_together(arm, tmp_path):
    with pytest.raises(LogError) as error:
        excite.convert([tmp_path / "a.csv", tmp_path / "b.mcap"], arm, tmp_path / "log")
    assert "a.csv" in str(error.value) and "b.mcap" in str(error.value)


def test_signed_counters_without_their_sign(arm, tmp_path):
    data = written.motion()
    load = np.round(100.0 * data["v"][:, :1])
    columns = (
        {"t": data["time"]} | named(data, q="q{n}") | {"tau1": np.where(load < 0, load + 65536, load)[:, 0]}
    )
    found = excite.convert(
        [table(tmp_path / "a.csv", columns)], arm, tmp_path / "log", Map(trials={"split": "none"})
    )
    assert any("signed" in note for note in found.notes)
    assert np.concatenate([trial.tau[:, 0] for trial in found.log.trials]).min() < 0.0


def test_a_header_is_written_for_trials_and_is_valid(arm, tmp_path):
    data = written.motion()
    folder = tmp_path / "trials"
    folder.mkdir()
    columns = {"time": data["time"]}
    columns |= {f"{c}.{j}": data[c][:, k] for c in ("q", "tau") for k, j in enumerate(JOINTS)}
    for name in ("a.csv", "b.csv"):
        table(folder / name, columns)
    (folder / "arm.urdf").write_text(arm.read_text())
    excite.write_header(folder)
    log = excite.load_log(folder)
    assert log.header.joints == JOINTS and [t.role for t in log.trials] == ["identification", "validation"]
    with pytest.raises(LogError, match="exists already"):
        excite.write_header(folder)


def test_a_log_is_not_converted_again(arm, tmp_path):
    data = written.motion()
    columns = {"time": data["time"]} | named(data, q="q{n}")
    log = excite.convert([table(tmp_path / "a.csv", columns)], arm, tmp_path / "log").folder
    with pytest.raises(LogError, match="is a log already; give it to excite doctor"):
        excite.convert([log], arm, tmp_path / "again")


def test_all_missing_fields_of_a_header_come_at_once(tmp_path):
    (tmp_path / "log.yaml").write_text("schema: excite.log/1\nbase: fixed\n")
    with pytest.raises(LogError) as error:
        excite.load_log(tmp_path)
    assert all(name in str(error.value) for name in ("robot", "rate_hz", "joints", "torque", "trials"))


def simulated(robot: excite.Robot, order: str) -> dict[str, np.ndarray]:
    """Positions and velocities of a free base and its joints, as simulators hand them out."""
    time = np.arange(400) / 100.0
    n = robot.n_joints
    joints = 0.3 * np.sin(np.outer(time, np.linspace(1.0, 3.0, n)))
    angle = 0.1 * np.sin(time)
    quaternion = {"w": np.cos(angle), "x": np.sin(angle), "y": 0.0 * time, "z": 0.0 * time}
    pose = np.column_stack(
        [0.01 * time, 0.0 * time, 0.8 + 0.01 * np.cos(time), *(quaternion[k] for k in order)]
    )
    twist = np.gradient(np.column_stack([pose[:, :3], angle, angle, angle]), time, axis=0)
    qpos = np.column_stack([pose, joints])
    qvel = np.column_stack([twist, np.gradient(joints, time, axis=0)])
    return {"time": time, "qpos": qpos, "qvel": qvel, "qfrc_actuator": 10.0 * np.sin(3.0 * joints)}


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
def test_a_free_base_stands_before_its_joints(order, tmp_path):
    robot = excite.load_robot("g1")
    data = simulated(robot, order)
    np.savez(tmp_path / "run.npz", **data)
    whole = Map.model_validate(
        {"trials": {"split": "none", "validation": ["none"]}, "log": {"torque": "none"}}
    )
    log = excite.convert([tmp_path / "run.npz"], "g1", tmp_path / "log", whole).log
    trial = log.trials[0]
    np.testing.assert_allclose(trial.q, data["qpos"][:, 7:], atol=1e-9)
    np.testing.assert_allclose(trial.v, data["qvel"][:, 6:], atol=1e-9)
    np.testing.assert_allclose(trial.base[:, 2], data["qpos"][:, 2], atol=1e-9)
    np.testing.assert_allclose(trial.base[:, 6], data["qpos"][:, 3 + order.index("w")], atol=1e-6)


def test_how_the_base_of_a_bare_legged_model_was_carried_is_asked(tmp_path):
    model = example_robot_data() / "solo_description/robots/solo12.urdf"
    joints = [f"{leg}_{name}" for leg in ("FL", "FR", "HL", "HR") for name in ("HAA", "HFE", "KFE")]
    time = 0.005 * np.arange(800)
    data = {"t": time} | {f"q_{name}": 0.3 * np.sin((1.0 + 0.1 * k) * time) for k, name in enumerate(joints)}
    data |= {f"tau_{name}": np.cos(time + k) for k, name in enumerate(joints)}
    file = table(tmp_path / "a.csv", data)
    with pytest.raises(UnclearError, match="the base of solo is free") as caught:
        excite.convert([file], model, tmp_path / "log")
    assert "base: held" in str(caught.value)
    found = excite.convert([file], model, tmp_path / "log", Map(log={"base": "held"}))
    assert found.log.header.base == "held"


def test_columns_of_another_machine_are_asked_for(arm, tmp_path):
    time = np.arange(300) / 100.0
    np.savez(tmp_path / "run.npz", t=time, q=np.sin(np.outer(time, np.linspace(1.0, 2.0, 12))))
    with pytest.raises(UnclearError, match="12 columns for 3 joints"):
        excite.convert([tmp_path / "run.npz"], arm, tmp_path / "log")


def _pipe(file: Path) -> None:
    os.mkfifo(file)


def _text(content: str) -> Callable[[Path], None]:
    return lambda file: file.write_text(content) and None


ROWS = "".join(f"{{time}},0.{k},0.1,0.2\n" for k in range(10, 60))
WILD = "".join(f"{k},1e308,-1e300,1\n" for k in range(60))
UNREADABLE = {
    "a pipe": ("run.csv", _pipe, "is a pipe"),
    "a bag that is a pipe": ("run.mcap", _pipe, "is a pipe"),
    "names alone": ("run.csv", _text("t,q1,q2,q3\n"), "no columns of numbers"),
    "times that are none": ("run.csv", _text("time,q1,q2,q3\n" + ROWS.format(time="nan")), "column of times"),
    "one time": ("run.csv", _text("time,q1,q2,q3\n" + ROWS.format(time="1.0")), "column of times .time"),
    "numbers of no joint": ("run.csv", _text("time,q1,q2,q3\n" + WILD), "unit"),
    "lists of several lengths": ("run.json", _text('{"q": [[1, 2], [3]], "t": [1e999, NaN]}'), "no columns of numbers"),
    "brackets without end": ("run.json", _text("[" * 100_000), "cannot be read as JSON"),
    "a type of its own": ("run.jsonl", _text('{"t": {"t": {"t": 1}}}\n'), "no columns of numbers"),
}  # fmt: skip


@pytest.mark.parametrize("name", UNREADABLE)
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_what_cannot_be_understood_is_one_line(name, arm, tmp_path):
    file, write, said = UNREADABLE[name]
    write(tmp_path / file)
    with pytest.raises(LogError, match=said) as error:
        excite.convert([tmp_path / file], arm, tmp_path / "log")
    assert "\n" not in str(error.value) and not (tmp_path / "log").exists()


def test_what_the_map_says_is_modelled_is_no_guess(tmp_path):
    arm, data = written.arm_urdf(tmp_path / "arm.urdf"), written.motion()
    file = table(tmp_path / "a.csv", {"t": data["time"]} | named(data, q="q{n}", tau="tau{n}"))
    usual = written.whole(file, arm, tmp_path / "usual")
    stated = written.whole(file, arm, tmp_path / "stated", log={"modelled": ["rigid_body_fixed"]})
    assert [[what for what, *_ in found.guesses].count("modelled") for found in (usual, stated)] == [1, 0]
    assert stated.log.header.modelled == ("rigid_body_fixed",)


def test_a_range_that_nobody_filled_in_says_nothing_of_units(arm, tmp_path):
    """As SolidWorks' exporter leaves it: both ends zero, and no effort either."""
    text = arm.read_text().replace(
        'lower="-2.5" upper="2.5" effort="60" velocity="4"', 'lower="0" upper="0" effort="0" velocity="0"'
    )
    arm.write_text(text)
    data = written.motion()
    file = table(tmp_path / "a.csv", {"time": data["time"], **named(data, q="q{n}")})
    done = excite.convert([file], arm, tmp_path / "log", written.WHOLE)
    np.testing.assert_allclose(done.log.trials[0].q, data["q"], atol=1e-6)
    assert done.chart is not None
    assert not {finding.kind for finding in done.chart.findings} & {"degrees", "beyond_limits"}


def test_what_the_map_says_was_measured_was(arm, tmp_path):
    """Beside columns that say themselves what they are: what was asked of the joints."""
    data = written.motion()
    columns = {
        "time": data["time"],
        **named(data, q="phi_r_{n}", tau="mot{n}"),
        **{f"q_ref_{k}": data["q_cmd"][:, k - 1] for k in (1, 2, 3)},
        **{f"tau_ff_{k}": 0.9 * data["tau"][:, k - 1] for k in (1, 2, 3)},
    }
    file = table(tmp_path / "a.csv", columns)
    stated = Map.model_validate(
        {"columns": {"q": "phi_r_{n}", "tau": "mot{n}"}, "trials": {"split": "none", "validation": ["none"]}}
    )
    done = excite.convert([file], arm, tmp_path / "log", stated)
    np.testing.assert_allclose(done.log.trials[0].q, data["q"], atol=1e-6)
    np.testing.assert_allclose(done.log.trials[0].tau, data["tau"], atol=1e-6)
