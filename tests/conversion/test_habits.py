"""Tables as people write them: what stands in a log must be what was measured, whatever the habit."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

import excite
from excite.conversion.convert import Conversion
from excite.conversion.explicit_mapping import Map, read_map
from excite.conversion.guesses import UnclearError
from excite.errors import LogError
from tests.conversion import written
from tests.conversion.written import JOINTS, WHOLE

pytestmark = pytest.mark.usefixtures("unexamined", "readers_here")


def table(file: Path, columns: dict[str, object], separator: str = ",") -> Path:
    """A text table; a column's cells are numbers or texts, None for an empty cell."""
    cells = [
        ["" if x is None or x != x else (x if isinstance(x, str) else f"{x:.9g}") for x in column]
        for column in columns.values()
    ]
    lines = [separator.join(columns)] + [separator.join(row) for row in zip(*cells, strict=True)]
    file.write_text("\n".join(lines) + "\n")
    return file


def columns_of(data: dict[str, np.ndarray], **patterns: str) -> dict[str, np.ndarray]:
    """Columns by patterns such as ``q="pos_{n0}"``, after ``time``."""
    found = {"time": data["time"]}
    for channel, pattern in patterns.items():
        for k, joint in enumerate(JOINTS):
            found[pattern.format(n=k + 1, n0=k, joint=joint)] = data[channel][:, k]
    return found


def check(
    conversion: Conversion,
    data: dict[str, np.ndarray],
    *channels: str,
    rows: slice = slice(None),
    trial: int = 0,
) -> None:
    """Every channel of a trial is that of the motion, joint by joint."""
    table = pq.read_table(conversion.folder / conversion.log.header.trials[trial].file)
    for channel in channels:
        for k, joint in enumerate(JOINTS):
            found = table[f"{channel}.{joint}"].to_numpy()
            np.testing.assert_allclose(found, data[channel][rows, k], atol=1e-6, err_msg=f"{channel}.{joint}")


def test_a_last_column_that_is_empty_to_begin_with_loses_no_names(data, arm, tmp_path):
    columns = columns_of(data, q="/joint_states/{joint}/position", tau="/joint_states/{joint}/effort")
    columns["/tf/x"] = np.full(600, np.nan)
    columns["/tf/x"][300::7] = 0.5
    file = table(tmp_path / "juggler.csv", columns)
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), data, "q", "tau")


def test_a_last_column_without_a_name_loses_no_names(data, arm, tmp_path):
    columns = {
        "": np.arange(600.0),
        **columns_of(data, q="joint_{n0}_pos", tau="joint_{n0}_eff"),
        " ": data["time"] * 0,
    }
    file = table(tmp_path / "pandas.csv", columns)
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), data, "q", "tau")


@pytest.mark.parametrize("missing", ["", "nan"])
def test_rows_before_a_stream_starts_are_left_out(missing, data, arm, tmp_path):
    columns: dict[str, object] = columns_of(data, q="q{n}", tau="tau{n}")
    for name, values in columns.items():
        if name.startswith("tau"):
            columns[name] = [missing] * 100 + [f"{x:.9g}" for x in values[100:]]
    file = table(tmp_path / "late.csv", columns)
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), data, "q", "tau", rows=slice(100, None))


def test_the_desired_and_the_motors_side_of_a_state_are_not_its_joints(data, arm, tmp_path):
    wrong = {**data, "cmd": data["q"] + 0.1, "theta": data["q"] + 0.2, "rate": data["tau"] * 9.0}
    columns = columns_of(
        wrong, q="state.q[{n0}]", cmd="state.q_d[{n0}]", theta="state.theta[{n0}]", tau="state.tau_J[{n0}]"
    )
    columns |= columns_of(wrong, rate="state.dtau_J[{n0}]")
    conversion = excite.convert([table(tmp_path / "state.csv", columns)], arm, tmp_path / "log", WHOLE)
    check(conversion, data, "q", "tau")
    assert conversion.columns["q_cmd.elbow"][0] == "state.q_d[1]"


def test_plural_names_of_arrays(data, arm, tmp_path):
    file = tmp_path / "arrays.npz"
    np.savez(file, ts=data["time"], qs=data["q"], dqs=data["v"], taus=data["tau"])
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), data, "q", "v", "tau")


@pytest.mark.parametrize("joint", ["joint", "motor_id"])
def test_a_table_with_a_row_a_joint_is_refused(joint, data, arm, tmp_path):
    names = list(JOINTS[::-1]) if joint == "joint" else [1, 2, 3]
    columns = {
        "time": np.repeat(data["time"], 3),
        joint: names * 600,
        "position": data["q"][:, ::-1].ravel(),
        "effort": data["tau"][:, ::-1].ravel(),
    }
    with pytest.raises(LogError, match=f"{joint}: says whose joint each row is; write .* a column a joint"):
        excite.convert([table(tmp_path / "long.csv", columns)], arm, tmp_path / "log")


@pytest.mark.parametrize(("brackets", "between"), [("[]", " "), ("()", ", "), ("[]", "\n ")])
def test_arrays_in_cells(brackets, between, data, arm, tmp_path):
    def cells(values):
        inner = between.join(f"{x:.9g}" for x in values)
        return f'"{brackets[0]}{inner}{brackets[1]}"'

    columns = {"time": data["time"]} | {key: [cells(row) for row in data[key]] for key in ("q", "tau")}
    file = table(tmp_path / "frame.csv", columns)
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), data, "q", "tau")


def test_seconds_and_nanoseconds_are_one_time(data, arm, tmp_path):
    whole = data["time"] + 1_700_000_000.25
    columns = {"sec": np.floor(whole).astype(int).astype(str).tolist()}
    columns["nanosec"] = np.round((whole - np.floor(whole)) * 1e9).astype(int).astype(str).tolist()
    columns |= columns_of(data, q="q{n}", tau="tau{n}")
    del columns["time"]
    conversion = excite.convert([table(tmp_path / "s.csv", columns)], arm, tmp_path / "log", WHOLE)
    check(conversion, data, "q", "tau")
    assert conversion.log.header.rate_hz == pytest.approx(100.0, rel=1e-3)


@pytest.mark.parametrize("word", [False, True])
def test_a_column_that_counts_trials(word, arm, tmp_path):
    trials = [written.motion(seed=k) for k in range(3)]
    columns = {"trial_id": [f"run{k}" if word else str(k) for k in range(3) for _ in range(600)]}
    columns["t"] = np.arange(1800) / 100.0
    for key, pattern in (("q", "q{}"), ("tau", "tau{}")):
        columns |= {
            pattern.format(k): np.concatenate([trial[key][:, k] for trial in trials]) for k in range(3)
        }
    rules = Map.model_validate({"trials": {"split": "none"}})
    conversion = excite.convert([table(tmp_path / "t.csv", columns)], arm, tmp_path / "log", rules)
    assert len(conversion.trials) == 3
    for k, data in enumerate(trials):
        check(conversion, data, "q", "tau", trial=k)


ORDER = [2, 0, 1]


def names_in_npz(file: Path, data: dict[str, np.ndarray], names: list[str]) -> None:
    np.savez(
        file, t=data["time"], joint_names=np.array(names), q=data["q"][:, ORDER], tau=data["tau"][:, ORDER]
    )


def names_in_json(file: Path, data: dict[str, np.ndarray], names: list[str]) -> None:
    lists = {"time": data["time"].tolist(), "joint_names": names}
    file.write_text(json.dumps(lists | {key: data[key][:, ORDER].tolist() for key in ("q", "tau")}))


def names_in_lines(file: Path, data: dict[str, np.ndarray], names: list[str]) -> None:
    rows = zip(data["time"], data["q"][:, ORDER].tolist(), data["tau"][:, ORDER].tolist(), strict=True)
    lines = [{"t": t, "msg": {"name": names, "position": q, "effort": tau}} for t, q, tau in rows]
    file.write_text("\n".join(json.dumps(line) for line in lines))


def names_in_mat(file: Path, data: dict[str, np.ndarray], names: list[str]) -> None:
    cell = np.array(names, dtype=object)
    savemat(
        file, {"jointNames": cell, "t": data["time"], "q": data["q"][:, ORDER], "tau": data["tau"][:, ORDER]}
    )


def names_in_hdf5(file: Path, data: dict[str, np.ndarray], names: list[str]) -> None:
    with h5py.File(file, "w") as target:
        target["t"], target["q"], target["tau"] = data["time"], data["q"][:, ORDER], data["tau"][:, ORDER]
        target["q"].attrs["columns"] = names


def names_in_columns(file: Path, data: dict[str, np.ndarray], names: list[str]) -> None:
    columns = {"%time": [str(int(1e18 + t * 1e9)) for t in data["time"]]}
    columns |= {f"field.name{k}": [name] * 600 for k, name in enumerate(names)}
    for key, word in (("q", "position"), ("tau", "effort")):
        columns |= {f"field.{word}{k}": data[key][:, at] for k, at in enumerate(ORDER)}
    table(file, columns)


@pytest.mark.parametrize(
    ("suffix", "write"),
    [
        (".npz", names_in_npz),
        (".json", names_in_json),
        (".jsonl", names_in_lines),
        (".mat", names_in_mat),
        (".h5", names_in_hdf5),
        (".csv", names_in_columns),
    ],
)
def test_joints_stand_in_the_order_of_the_names_beside_them(suffix, write, data, arm, tmp_path):
    file = tmp_path / f"ordered{suffix}"
    write(file, data, [JOINTS[k] for k in ORDER])
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), data, "q", "tau")


def test_trials_in_groups_of_a_group(arm, tmp_path):
    trials = [written.motion(seed=k) for k in range(2)]
    with h5py.File(tmp_path / "demos.hdf5", "w") as file:
        for k, trial in enumerate(trials):
            group = file.create_group(f"data/demo_{k}")
            group["timestamps"] = trial["time"]
            group["obs/joint_pos"], group["obs/joint_torques"] = trial["q"], trial["tau"]
    rules = Map.model_validate({"trials": {"split": "none"}})
    conversion = excite.convert([tmp_path / "demos.hdf5"], arm, tmp_path / "log", rules)
    for k, trial in enumerate(trials):
        check(conversion, trial, "q", "tau", trial=k)


def test_a_group_a_signal_with_a_time_of_its_own(data, arm, tmp_path):
    file = tmp_path / "simulink.mat"
    signals = {
        f"{name}_log": {"time": data["time"], "signals": {"values": data[key], "label": name}}
        for name, key in (("q", "q"), ("tau", "tau"))
    }
    savemat(file, signals)
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), data, "q", "tau")


def test_a_clock_that_starts_anew_parts_trials(arm, tmp_path):
    trials = [written.motion(seed=k) for k in range(2)]
    whole = {key: np.concatenate([trial[key] for trial in trials]) for key in trials[0]}
    file = table(tmp_path / "runs.csv", columns_of(whole, q="q{n}", tau="tau{n}"))
    rules = Map.model_validate({"trials": {"split": "none"}})
    conversion = excite.convert([file], arm, tmp_path / "log", rules)
    assert len(conversion.trials) == 2
    for k, trial in enumerate(trials):
        check(conversion, trial, "q", "tau", trial=k)


def test_a_counter_of_microseconds_goes_over_its_end(data, arm, tmp_path):
    columns = columns_of(data, q="q{n}", tau="tau{n}")
    ticks = (np.round(data["time"] * 1e6).astype(np.int64) + 2**32 - 2_000_000) % 2**32
    columns = {"micros": [str(tick) for tick in ticks]} | {k: v for k, v in columns.items() if k != "time"}
    conversion = excite.convert([table(tmp_path / "c.csv", columns)], arm, tmp_path / "log", WHOLE)
    check(conversion, data, "q", "tau")
    assert conversion.log.header.rate_hz == pytest.approx(100.0)


def test_rows_out_of_order_are_sorted(data, arm, tmp_path):
    order = np.arange(600)
    for k in range(0, 590, 6):
        order[[k, k + 3]] = order[[k + 3, k]]
    mixed = {key: values[order] for key, values in data.items()}
    file = table(tmp_path / "mixed.csv", columns_of(mixed, q="q{n}", tau="tau{n}"))
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), data, "q", "tau")


@pytest.mark.parametrize("said", [{"Ts": 0.01}, {"fs": 100}, {"dt_ms": 10}])
def test_a_rate_or_step_that_the_file_states_is_its_clock(said, data, arm, tmp_path):
    file = tmp_path / "rated.npz"
    np.savez(file, q=data["q"], tau=data["tau"], **said)
    conversion = excite.convert([file], arm, tmp_path / "log", WHOLE)
    check(conversion, data, "q", "tau")
    assert conversion.log.header.rate_hz == pytest.approx(100.0)


def parts_of(data: dict[str, np.ndarray], folder: Path, shift: float) -> list[Path]:
    """Positions at 100 Hz in one file; torques at 50 Hz, a second later, in another one."""
    slow = {key: values[100::2] for key, values in data.items()}
    slow["time"] = slow["time"] + shift
    return [
        table(folder / "positions.csv", columns_of(data, q="q{n}")),
        table(folder / "torques.csv", columns_of(slow, tau="tau{n}")),
    ]


def test_files_of_two_rates_are_joined_by_their_clock(data, arm, tmp_path):
    conversion = excite.convert(parts_of(data, tmp_path, 0.0), arm, tmp_path / "log", WHOLE)
    check(conversion, data, "q", "tau", rows=slice(100, None, 2))


def test_files_without_a_common_time_are_refused(data, arm, tmp_path):
    with pytest.raises(LogError, match=r"not over the same time: positions from 0 to 5\.99 s"):
        excite.convert(parts_of(data, tmp_path, 100.0), arm, tmp_path / "log", WHOLE)


def test_of_two_arms_with_the_same_joints_one_is_asked_for(data, arm, tmp_path):
    other = {**data, "q": data["q"][::-1], "tau": data["tau"][::-1]}
    columns = columns_of(data, q="left_{joint}_pos", tau="left_{joint}_torque")
    columns |= columns_of(other, q="right_{joint}_pos", tau="right_{joint}_torque")
    file = table(tmp_path / "arms.csv", columns)
    with pytest.raises(UnclearError) as refused:
        excite.convert([file], arm, tmp_path / "log", WHOLE)
    lines = [question.line for question in refused.value.questions]
    assert lines == ['columns: {q: "left_{joint}_pos"}', 'columns: {tau: "left_{joint}_torque"}']
    settled = WHOLE.model_copy(update={"columns": {"q": "left_{joint}_pos", "tau": "left_{joint}_torque"}})
    check(excite.convert([file], arm, tmp_path / "log", settled), data, "q", "tau")


def test_names_that_fit_the_robots_order_only_in_part(data, arm, tmp_path):
    columns = {"time": data["time"]}
    for key, word in (("q", "angle"), ("tau", "torque")):
        columns |= {f"{label} {word}": data[key][:, k] for k, label in enumerate(("Base", "Elbow", "Wrist"))}
    file = table(tmp_path / "words.csv", columns)
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), data, "q", "tau")


def test_zeros_before_a_stream_starts_are_no_positions(data, arm, tmp_path):
    late = {key: values.copy() for key, values in data.items()}
    late["q"][:50], late["tau"][:120] = 0.0, 0.0
    file = table(tmp_path / "zeros.csv", columns_of(late, q="q{n}", tau="tau{n}"))
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), data, "q", "tau", rows=slice(120, None))


def test_a_motion_that_begins_at_zero_is_whole(data, arm, tmp_path):
    rise = np.minimum(np.maximum(data["time"] - 0.5, 0.0), 1.0)[:, None] ** 2
    slow = {**data, "q": rise * data["q"], "tau": rise * data["tau"]}
    file = table(tmp_path / "rises.csv", columns_of(slow, q="q{n}", tau="tau{n}"))
    check(excite.convert([file], arm, tmp_path / "log", WHOLE), slow, "q", "tau")


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("a.joblib", "joblib"),
        ("a.pkl", "is a pickle"),
        ("a.xlsx", "workbook"),
        ("a.feather", "to_parquet"),
        ("a.zip", "unpack"),
    ],
)
def test_files_that_are_not_opened_are_refused_with_what_to_do(name, reason, arm, tmp_path):
    (tmp_path / name).write_bytes(b"\x80\x04\x00PK")
    with pytest.raises(LogError, match=reason):
        excite.convert([tmp_path / name], arm, tmp_path / "log")


@pytest.mark.parametrize(
    ("name", "begins", "remedy"),
    [
        ("flight.ulg", b"ULog\x01\x12\x35\x01", "ulog2csv"),
        ("session.rrd", b"RRF2\x00", "Parquet"),
        ("lcmlog-2020-05-01.00", b"\xed\xa1\xda\x01\x00", "lcm.EventLog"),
        ("printed.txt", b"header:\n  stamp:\n", "ros2 bag record"),
        ("steps-train.tfrecord-00000-of-00004", b"\x10\x00", "numpy.savez"),
    ],
)
def test_files_of_other_tools_are_known_by_what_they_begin_with(name, begins, remedy, arm, tmp_path):
    (tmp_path / name).write_bytes(begins + bytes(range(200)))
    with pytest.raises(LogError, match=remedy):
        excite.convert([tmp_path / name], arm, tmp_path / "log")


@pytest.mark.parametrize(
    ("count", "turn", "rate"), [(4096, 2.0 * np.pi, 0.229), (1024, np.radians(300.0), 0.111)]
)
def test_counts_of_servos(count, turn, rate, data, arm, tmp_path):
    counts = {**data, "q": np.round(data["q"] / turn * count + count / 2)}
    counts["v"] = np.round(data["v"] / (rate * np.pi / 30.0))
    columns = columns_of(
        counts, q="{joint}_present_position", v="{joint}_present_velocity", tau="{joint}_effort"
    )
    conversion = excite.convert([table(tmp_path / "s.csv", columns)], arm, tmp_path / "log", WHOLE)
    found = pq.read_table(conversion.folder / conversion.log.header.trials[0].file)
    for k, joint in enumerate(JOINTS):
        np.testing.assert_allclose(found[f"q.{joint}"], data["q"][:, k], atol=turn / count)
        np.testing.assert_allclose(found[f"v.{joint}"], data["v"][:, k], atol=rate * np.pi / 30.0)


def test_names_below_headings(data, arm, tmp_path):
    rows = np.column_stack([data["time"], data["q"], data["tau"]])
    lines = ["time,position,,,effort,,", ",".join(["", *JOINTS, *JOINTS])]
    lines += [",".join(f"{x:.9g}" for x in row) for row in rows]
    (tmp_path / "headed.csv").write_text("\n".join(lines))
    check(excite.convert([tmp_path / "headed.csv"], arm, tmp_path / "log", WHOLE), data, "q", "tau")


def test_an_object_for_each_motor(data, arm, tmp_path):
    fields = ("q", "dq", "tau_est")
    table = np.stack([data["q"], data["v"], data["tau"]], axis=2).tolist()
    lines = [
        {"tick": int(t * 1000), "motor_state": [dict(zip(fields, motor, strict=True)) for motor in row]}
        for t, row in zip(data["time"], table, strict=True)
    ]
    (tmp_path / "low.jsonl").write_text("\n".join(json.dumps(line) for line in lines))
    check(excite.convert([tmp_path / "low.jsonl"], arm, tmp_path / "log", WHOLE), data, "q", "v", "tau")


def test_shares_of_a_rated_torque_are_no_torques(data, arm, tmp_path):
    file = table(tmp_path / "share.csv", columns_of(data, q="q{n}", tau="torque_percent_{n}"))
    with pytest.raises(UnclearError, match="torque per unit is not known"):
        excite.convert([file], arm, tmp_path / "log", WHOLE)


def test_currents_of_either_sign_that_were_written_without_one(data, arm, tmp_path):
    one_sided = -np.abs(data["tau"][:, 2]) - 0.01
    signed = np.round(100.0 * np.column_stack([data["tau"][:, :2] - 5.0, one_sided]))
    columns = columns_of({**data, "i": signed % 2**16}, q="{joint}_pos", i="{joint}_current")
    conversion = excite.convert([table(tmp_path / "u.csv", columns)], arm, tmp_path / "log", WHOLE)
    check(conversion, {**data, "i": signed}, "q", "i")


def test_the_order_of_four_legs_is_no_silent_guess(data, tmp_path):
    legs = [f"{leg}_{joint}_joint" for leg in ("FR", "FL", "RR", "RL") for joint in ("hip", "thigh", "calf")]
    rng = np.random.default_rng(0)
    moves = {key: 0.3 * np.sin(rng.uniform(1.0, 4.0, 12) * data["time"][:, None]) for key in ("q", "tau")}
    moves["q"] += np.tile([0.0, 0.9, -1.6], 4)
    columns = {"t": data["time"]} | {f"{key}_{k}": moves[key][:, k] for key in moves for k in range(12)}
    file = table(tmp_path / "legs.csv", columns)
    held = WHOLE.model_copy(update={"log": {"base": "held"}})
    guessed = excite.convert([file], "go2", tmp_path / "log", held).guesses
    assert [why for what, _, why in guessed if what == "order of legs" and "joints: [JOINT, …]" in why]
    # Which joints there are is said of positions; torques without a cause are dear to examine.
    file = table(tmp_path / "positions.csv", {name: c for name, c in columns.items() if "tau" not in name})
    conversion = excite.convert(
        [file], "go2", tmp_path / "log", held.model_copy(update={"joints": tuple(legs)})
    )
    assert conversion.columns["q.FR_hip_joint"][0] == "q_0"
    assert "order of legs" not in [what for what, _, _ in conversion.guesses]


@pytest.mark.parametrize("suffix", [".mat", ".h5"])
def test_what_describes_the_trials_beside_them_is_none_of_them(suffix, arm, tmp_path):
    """A cell array of structs, or groups, and one more that says whose and in which units they are."""
    trials = [written.motion(seed=k) for k in range(2)]
    file, info = tmp_path / f"day{suffix}", {"robot": "arm", "fs": 100.0, "units": "rad, Nm"}
    if suffix == ".mat":
        cells = np.empty(2, dtype=object)
        cells[:] = [{key: trial[key] for key in ("time", "q", "tau")} for trial in trials]
        savemat(file, {"runs": cells, "info": info})
    else:
        with h5py.File(file, "w") as target:
            for k, trial in enumerate(trials):
                for key in ("time", "q", "tau"):
                    target[f"run{k}/{key}"] = trial[key]
            for key, value in info.items():
                target[f"info/{key}"] = value
    rules = Map.model_validate({"trials": {"split": "none"}})
    conversion = excite.convert([file], arm, tmp_path / "log", rules)
    assert len(conversion.log.trials) == 2
    for k, trial in enumerate(trials):
        check(conversion, trial, "q", "tau", trial=k)


def test_a_field_of_the_log_in_the_map_is_told_its_place(tmp_path):
    (tmp_path / "map.yaml").write_text("rate_hz: 100\n")
    with pytest.raises(LogError, match=r"rate_hz \(belongs under log: \{rate_hz: …\}\)"):
        read_map(tmp_path / "map.yaml")


def test_a_joint_without_a_column_is_said_to_be_nobody_knows_where(data, arm, tmp_path):
    columns = {
        k: v for k, v in columns_of(data, q="q_{joint}", tau="tau_{joint}").items() if JOINTS[-1] not in k
    }
    file = table(tmp_path / "log.csv", columns)
    conversion = excite.convert([file], robot=arm, out=tmp_path / "log", mapping=WHOLE)
    said = {row.what: row for row in conversion.log.header.guessed}
    assert JOINTS[-1] in str(said["joints without positions"])
    # What has a torque may move.
    columns[f"tau_{JOINTS[-1]}"] = data["tau"][:, len(JOINTS) - 1]
    file = table(tmp_path / "forced.csv", columns)
    with pytest.raises(LogError, match=f"no position of that joint was found.*q.{JOINTS[-1]}"):
        excite.convert([file], robot=arm, out=tmp_path / "forced", mapping=WHOLE)
    left = WHOLE.model_copy(update={"ignore": (f"tau_{JOINTS[-1]}",)})
    assert (
        len(excite.convert([file], robot=arm, out=tmp_path / "forced", mapping=left).log.header.joints)
        == len(JOINTS) - 1
    )


def test_more_names_than_cells_are_not_believed_and_said(data, arm, tmp_path):
    """A logger for seven joints on an arm of three: its names would call velocities positions."""
    rows = np.column_stack([data["time"], data["q"], data["v"]])
    names = ["time", *(f"q{k}" for k in range(1, 8)), *(f"dq{k}" for k in range(1, 8))]
    lines = [",".join(names)] + [",".join(f"{x:.9g}" for x in row) for row in rows]
    (tmp_path / "long.csv").write_text("\n".join(lines))
    robot = Map(log={"torque": "none"}, trials=WHOLE.trials)
    with pytest.raises(UnclearError, match="line of names has 15 cells and its rows have 7"):
        excite.convert([tmp_path / "long.csv"], arm, tmp_path / "log", robot)
    places = {
        f"{what}.{joint}": f"column{3 * k + n + 2}"
        for k, what in enumerate("qv")
        for n, joint in enumerate(JOINTS)
    }
    stated = robot.model_copy(update={"columns": {"time": "column1"} | places})
    found = excite.convert([tmp_path / "long.csv"], arm, tmp_path / "log", stated)
    assert any("line of names has 15 cells and its rows have 7" in note for note in found.notes)
    check(found, data, "q", "v")
    columns = rows[:, :3]
    lines = [",".join(names)] + [",".join(f"{x:.9g}" for x in row) for row in columns]
    (tmp_path / "few.csv").write_text("\n".join(lines))
    with pytest.raises(UnclearError, match="line of names has 15 cells and its rows have 3"):
        excite.convert([tmp_path / "few.csv"], arm, tmp_path / "log", robot)


def test_a_list_of_trials_with_arrays_and_a_rate_beside_it(arm, tmp_path):
    """As a script keeps what it did: settings, then an object a motion, of any length."""
    trials = [written.motion(n=300 + 40 * k) for k in range(3)]
    content = {
        "config": {"action_hz": 100, "joint_limits": [-1, 1]},
        "data": [
            {
                "type": "chirp",
                "targets": [],
                **{f"q_{joint}": trial["q"][:, k].tolist() for k, joint in enumerate(JOINTS)},
                "torque": trial["tau"].tolist(),
            }
            for trial in trials
        ],
    }
    (tmp_path / "set.json").write_text(json.dumps(content))
    rules = Map.model_validate({"trials": {"split": "none"}})
    conversion = excite.convert([tmp_path / "set.json"], arm, tmp_path / "log", rules)
    assert conversion.log.header.rate_hz == pytest.approx(100.0)
    assert len(conversion.log.trials) == 3
    for k, trial in enumerate(trials):
        check(conversion, trial, "q", "tau", trial=k)
