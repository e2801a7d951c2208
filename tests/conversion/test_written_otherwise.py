"""Recordings that say what they hold in ways of their own: their topics, records, units, and clocks."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import excite
from excite.conversion.convert import Conversion
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import UnclearError
from excite.errors import LogError
from tests.conversion import written
from tests.conversion.written import JOINTS, whole

pytestmark = pytest.mark.usefixtures("readers_here", "unexamined")

N = 300


@pytest.fixture(scope="module")
def data() -> dict[str, np.ndarray]:
    return written.motion(N)


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written.arm_urdf(tmp_path_factory.mktemp("arm") / "arm.urdf")


def holds(found: Conversion, data: dict[str, np.ndarray], atol: float = 1e-5) -> None:
    trial = found.log.trials[0]
    np.testing.assert_allclose(trial.time - trial.time[0], data["time"], atol=1e-6)
    np.testing.assert_allclose(trial.q, data["q"], atol=atol)
    np.testing.assert_allclose(trial.tau, data["tau"], atol=atol)


def table(file: Path, names: list[str], *columns: np.ndarray, comment: str = "") -> Path:
    rows = np.column_stack(columns)
    np.savetxt(file, rows, delimiter=",", header=f"{comment}{','.join(names)}", comments="", fmt="%.9g")
    return file


@pytest.mark.parametrize(
    ("unit", "per_nm"),
    [("mNm", 1e3), ("Ncm", 1e2), ("kgcm", 1 / 0.0980665), ("ozin", 141.6119), ("lbft", 0.7375621)],
)
def test_units_of_torque_that_end_a_name(unit, per_nm, data, arm, tmp_path):
    names = ["t", *(f"q{k}" for k in range(3)), *(f"torque_{k}_{unit}" for k in range(3))]
    source = table(tmp_path / "a.csv", names, data["time"], data["q"], per_nm * data["tau"])
    holds(whole(source, arm, tmp_path), data, atol=1e-4)


@pytest.mark.parametrize(("unit", "per_rad"), [("turns", 0.5 / np.pi), ("mrad", 1e3)])
def test_units_of_angles(unit, per_rad, data, arm, tmp_path):
    names = ["t", *(f"pos{k} [{unit}]" for k in range(3)), *(f"tau{k}" for k in range(3))]
    source = table(tmp_path / "a.csv", names, data["time"], per_rad * data["q"], data["tau"])
    holds(whole(source, arm, tmp_path), data)


def test_a_counter_of_rows_is_no_clock(data, arm, tmp_path):
    """The rate that a comment states is taken, and asked for where none does: 100 Hz, not a row a millisecond."""
    names = ["frame", *(f"q{k}" for k in range(3)), *(f"tau{k}" for k in range(3))]
    columns = (np.arange(N), data["q"], data["tau"])
    said = table(tmp_path / "a.csv", names, *columns, comment="# sampling rate: 100 Hz\n")
    holds(whole(said, arm, tmp_path), data)
    with pytest.raises(UnclearError, match="rate_hz"):
        whole(table(tmp_path / "b.csv", names, *columns), arm, tmp_path)


def test_records_in_hdf5(data, arm, tmp_path):
    import h5py

    rows = np.zeros(N, dtype=[("time", "f8"), ("q", "f8", 3), ("tau", "f8", 3)])
    for name in ("time", "q", "tau"):
        rows[name] = data[name]
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["samples"] = rows
    holds(whole(tmp_path / "run.h5", arm, tmp_path), data)


def test_sensors_of_a_simulator_by_a_list_of_their_names(data, arm, tmp_path):
    names = [f"{joint}_{kind}" for joint in JOINTS for kind in ("pos", "frc")]
    values = np.stack([data["q"], data["tau"]], axis=2).reshape(N, 6)
    np.savez(tmp_path / "run.npz", time=data["time"], sensordata=values, sensor_names=np.array(names))
    holds(whole(tmp_path / "run.npz", arm, tmp_path), data)


def mcap_of_json(path: Path, time: np.ndarray, topics: dict[str, dict[str, np.ndarray]]) -> Path:
    """Messages of JSON, an array or more each, on topics."""
    from mcap.writer import Writer

    with path.open("wb") as stream:
        bag = Writer(stream)
        bag.start()
        channels = {topic: bag.register_channel(topic, "json", 0) for topic in topics}
        for k, now in enumerate(np.round(1e9 * (100.0 + time)).astype(int).tolist()):
            for topic, arrays in topics.items():
                body = json.dumps({name: values[k].tolist() for name, values in arrays.items()})
                bag.add_message(channels[topic], now, body.encode(), now)
        bag.finish()
    return path


def test_arrays_are_what_their_topics_are_called(data, arm, tmp_path):
    topics = {"/arm/position": {"data": data["q"]}, "/arm/torque": {"data": data["tau"]}}
    holds(whole(mcap_of_json(tmp_path / "a.mcap", data["time"], topics), arm, tmp_path), data)


def test_a_signal_that_is_logged_twice_is_not_asked_about(data, arm, tmp_path):
    state = {"position": data["q"], "effort": data["tau"]}
    again = {"a/joints": state, "b/joints": {"position": data["q"]}}
    found = whole(mcap_of_json(tmp_path / "a.mcap", data["time"], again), arm, tmp_path)
    holds(found, data)
    assert any("same values" in because for _, _, because in found.guesses)
    other = {"a/joints": state, "b/joints": {"position": data["q"] + 0.1 * data["v"]}}
    with pytest.raises(UnclearError, match="q may be"):
        whole(mcap_of_json(tmp_path / "b.mcap", data["time"], other), arm, tmp_path)


def test_a_topic_of_external_torques_is_no_rival(data, arm, tmp_path):
    topics = {
        "/arm/external_torques": {"effort": 0.1 * data["tau"][:, ::-1]},
        "/arm/joint_states": {"position": data["q"], "effort": data["tau"]},
    }
    holds(whole(mcap_of_json(tmp_path / "a.mcap", data["time"], topics), arm, tmp_path), data)


def test_lerobot_within_a_hundred_may_be_degrees_or_shares(data, arm, tmp_path):
    """LeRobot's servos report either, and nothing in a data set says which."""
    in_degrees = {**data, "q": np.degrees(data["q"]), "q_cmd": np.degrees(data["q_cmd"])}
    source = written.lerobot(tmp_path / "deg", in_degrees, version="v3.0")
    assert np.abs(in_degrees["q"]).max() < 100.0
    with pytest.raises(UnclearError, match="±100") as asked:
        excite.convert([source], arm, tmp_path / "log")
    assert len(asked.value.questions) == 1
    stated = Map.model_validate({"units": {"q": "deg", "q_cmd": "deg"}})
    found = excite.convert([source], arm, tmp_path / "log", stated)
    np.testing.assert_allclose(found.log.trials[0].q, data["q"][: N // 2], atol=1e-5)
    # The arm's joints turn by 2.5 rad to either side.
    shares = {**data, "q": data["q"] * 40.0, "q_cmd": data["q_cmd"] * 40.0}
    source = written.lerobot(tmp_path / "shares", shares, version="v2.1")
    found = excite.convert(
        [source], arm, tmp_path / "log", Map.model_validate({"units": {"q": "±100", "q_cmd": "±100"}})
    )
    np.testing.assert_allclose(found.log.trials[0].q, data["q"][: N // 2], atol=1e-5)
    np.testing.assert_allclose(found.log.trials[0].q_cmd, data["q_cmd"][: N // 2], atol=1e-5)


@pytest.mark.parametrize(
    ("names", "factor", "asks"),
    [
        ("{}.pos", 1.0, True),
        ("{}.pos", 1.1, True),
        ("{}.pos", 2.5, False),
        ("{}_angle", 1.0, True),
        ("{}_angle", 0.9, False),
    ],
)
def test_shares_in_a_table_are_asked_about_as_well(names, factor, asks, data, arm, tmp_path):
    """By LeRobot's names, where they pass 100 a little too; by others where several joints end at 100 of something."""
    most = np.array([100.0, 100.0, 80.0]) * factor
    columns = {"time": data["time"]} | {
        names.format(joint): most[k] * data["q"][:, k] / np.abs(data["q"][:, k]).max()
        for k, joint in enumerate(JOINTS)
    }
    file = tmp_path / "run.csv"
    rows = np.column_stack(list(columns.values()))
    np.savetxt(file, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")
    try:
        excite.convert([file], arm, tmp_path / "log")
        asked = False
    except UnclearError as error:
        asked = any(question.key == "shares or degrees" for question in error.questions)
    assert asked == asks


def test_a_scale_of_zero_is_refused_before_anything_is_written(arm, tmp_path):
    (tmp_path / "map.yaml").write_text("scale: {tau: 0}\n")
    with pytest.raises(LogError, match=r"scale\.tau"):
        excite.convert([tmp_path / "run.csv"], arm, tmp_path / "log", tmp_path / "map.yaml")
    assert not (tmp_path / "log").exists()


def test_a_definition_that_ros_does_not_allow_is_passed_over(data, arm, tmp_path):
    """A topic whose message has capitals in its fields cannot be decoded; the others of the file can."""
    from mcap.writer import Writer

    path = next(written.ros2_bag(tmp_path / "bag", data, mcap=True).glob("*.mcap"))
    from mcap.reader import make_reader

    odd = tmp_path / "odd.mcap"
    with path.open("rb") as read, odd.open("wb") as stream:
        bag = Writer(stream)
        bag.start("ros2", "drawn")
        schema = bag.register_schema("odd_msgs/msg/State", "ros2msg", b"float64[2] tau_J\n")
        strange = bag.register_channel("/odd", "cdr", schema)
        known: dict[int, int] = {}
        for kind, channel, message in make_reader(read).iter_messages():
            if channel.id not in known:
                of = bag.register_schema(kind.name, kind.encoding, kind.data)
                known[channel.id] = bag.register_channel(channel.topic, channel.message_encoding, of)
            bag.add_message(known[channel.id], message.log_time, message.data, message.publish_time)
            bag.add_message(strange, message.log_time, b"\0\1\0\0" + bytes(16), message.publish_time)
        bag.finish()
    holds(whole(odd, arm, tmp_path), data)


def test_angles_that_a_driver_keeps_within_a_turn(data, arm, tmp_path):
    """From 0 to 360 degrees: one joint crosses the seam, one is always a turn too high."""
    q = data["q"].copy()
    q[:, 1] -= np.max(q[:, 1]) + 0.05
    names = ["t", *(f"q{k}" for k in range(3)), *(f"tau{k}" for k in range(3))]
    source = table(tmp_path / "a.csv", names, data["time"], np.degrees(q) % 360.0, data["tau"])
    found = whole(source, arm, tmp_path)
    holds(found, {**data, "q": q})
    assert any("whole turns bring joints" in note and "q.elbow -1" in note for note in found.notes)
    assert any("whole turn goes on" in note for note in found.notes)


def test_axes_that_are_called_by_a_letter_are_no_accelerations(data, arm, tmp_path):
    kinds = ("pos", "trq", "ext_trq")
    names = ["ts", *(f"lbr_A{k + 1}_{kind}" for kind in kinds for k in range(3))]
    source = table(tmp_path / "a.csv", names, data["time"], data["q"], data["tau"], 0.1 * data["tau"])
    holds(whole(source, arm, tmp_path), data)


def test_arrays_of_two_rates_with_a_clock_each(data, arm, tmp_path):
    half = slice(None, None, 2)
    np.savez(
        tmp_path / "a.npz", t_q=data["time"], q=data["q"], t_tau=data["time"][half], tau=data["tau"][half]
    )
    found = whole(tmp_path / "a.npz", arm, tmp_path)
    holds(found, {name: data[name][half] for name in ("time", "q", "tau")})


def test_a_feed_forward_that_is_off_is_left_out(data, arm, tmp_path):
    names = ["t", *(f"{kind}{k}" for kind in ("q", "tau", "tau_cmd") for k in range(3))]
    constant = np.full_like(data["tau"], 0.1)
    source = table(tmp_path / "a.csv", names, data["time"], data["q"], data["tau"], constant)
    found = whole(source, arm, tmp_path)
    holds(found, data)
    assert found.log.trials[0].tau_cmd is None
