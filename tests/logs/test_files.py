"""Log folders on disk: what is written is read, and what is wrong is said in one line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from excite.errors import ExciteError, InputError, LogError
from excite.formats.registry import FORMATS
from excite.logs.files import load_log, save_log
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from excite.robot.robot import Robot


def change_header(folder: Path, **changes: object) -> None:
    """Overwrite fields of ``log.yaml``; None removes."""
    file = folder / "log.yaml"
    content = yaml.safe_load(file.read_text()) | changes
    file.write_text(yaml.safe_dump({name: value for name, value in content.items() if value is not None}))


def test_what_is_saved_is_loaded(arm_log: Log, tmp_path: Path) -> None:
    loaded = load_log(save_log(arm_log, tmp_path / "log"))
    assert loaded.header == arm_log.header
    assert loaded.robot_text == arm_log.robot_text
    assert len(loaded.role("identification")) == 2
    for trial, original in zip(loaded.trials, arm_log.trials, strict=True):
        for channel in ("time", "q", "tau", "q_cmd"):
            np.testing.assert_array_equal(getattr(trial, channel), getattr(original, channel))
        done = trial.cleaning
        assert (done.repeated_rows, done.reordered_rows, done.missing_rows) == (0, 0, 0)
        assert not done.clipped and not done.quantised
        assert (trial.name, trial.session, trial.start_s, trial.repeats) == (
            original.name,
            original.session,
            original.start_s,
            original.repeats,
        )


def test_saving_again_gives_the_same_bytes(arm_log: Log, tmp_path: Path) -> None:
    first = save_log(arm_log, tmp_path / "first")
    second = save_log(load_log(first), tmp_path / "second")
    for file in ("log.yaml", "one.parquet", "two.csv", "robot.urdf"):
        assert (first / file).read_bytes() == (second / file).read_bytes()


@pytest.mark.parametrize("name", list(FORMATS))
def test_every_format_keeps_every_number(name: str, tmp_path: Path) -> None:
    reader = FORMATS.make(name)
    if name == "hdf5":
        pytest.importorskip("h5py", reason="HDF5 needs h5py")
    values = np.random.default_rng(4).normal(size=(50, 2))
    path = tmp_path / f"trial{reader.suffixes[0]}"
    reader.write({"time": values[:, 0], "q.a joint": values[:, 1]}, path)
    columns = reader.read(path).columns
    assert list(columns) == ["time", "q.a joint"] or sorted(columns) == ["q.a joint", "time"]
    np.testing.assert_array_equal(columns["q.a joint"], values[:, 1])
    path.write_bytes(path.read_bytes()[:40])
    if name != "csv":
        with pytest.raises(InputError, match="cannot be read"):
            reader.read(path)
    with pytest.raises(InputError, match="no such file"):
        reader.read(tmp_path / f"absent{reader.suffixes[0]}")


def test_nothing_is_left_of_a_log_that_could_not_be_written(arm_log: Log, tmp_path: Path) -> None:
    broken = replace(
        arm_log, trials=(arm_log.trials[0], replace(arm_log.trials[1], tau=None), arm_log.trials[2])
    )
    with pytest.raises(LogError, match=r"tau\.shoulder"):
        save_log(broken, tmp_path / "log")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    with pytest.raises(LogError, match="is no log"):
        save_log(arm_log, tmp_path / "mine")
    assert (tmp_path / "mine" / "letter.txt").read_text() == "dear"


def test_a_log_that_a_person_wrote_is_not_replaced(arm_log: Log, tmp_path: Path) -> None:
    """Beside it may lie the only recordings of a robot."""
    folder = save_log(arm_log, tmp_path / "log")
    header = folder / "log.yaml"
    header.write_text("# my robot, on Monday\n" + header.read_text())
    before = {item.name: item.read_bytes() for item in folder.iterdir()}
    with pytest.raises(LogError, match=r"holds a log that excite did not write.* move that one away"):
        save_log(arm_log, folder)
    assert {item.name: item.read_bytes() for item in folder.iterdir()} == before


def test_what_lies_beside_a_replaced_log_is_kept(arm_log: Log, tmp_path: Path) -> None:
    folder = save_log(arm_log, tmp_path / "log")
    (folder / "notes.txt").write_text("elbow was warm")
    (folder / "photos").mkdir()
    (folder / "photos" / "arm.png").write_bytes(b"png")
    (folder / "link").symlink_to("notes.txt")
    entries = tuple(replace(trial) for trial in arm_log.trials[:2])
    header = arm_log.header.model_copy(update={"trials": arm_log.header.trials[:2]})
    save_log(replace(arm_log, header=header, trials=entries), folder)
    assert len(load_log(folder).trials) == 2
    assert not (folder / arm_log.header.trials[2].file).exists()
    assert (folder / "notes.txt").read_text() == "elbow was warm"
    assert (folder / "photos" / "arm.png").read_bytes() == b"png"
    assert (folder / "link").is_symlink()


def test_repeated_swapped_and_missing_rows_are_repaired_and_counted(
    edited: Callable[[Callable[[dict], None]], Path], arm_log: Log
) -> None:
    def spoil(columns: dict) -> None:
        for values in columns.values():
            values.insert(30, values[30])  # one row twice
            values[100], values[101] = values[101], values[100]  # two rows swapped
            del values[200:203]  # three rows lost

    trial = load_log(edited(spoil)).trials[1]
    assert (trial.cleaning.repeated_rows, trial.cleaning.reordered_rows, trial.cleaning.missing_rows) == (
        1,
        1,
        3,
    )
    assert trial.cleaning.longest_gap_s == pytest.approx(0.04)
    assert (np.diff(trial.time) > 0.0).all()
    at = np.searchsorted(arm_log.trials[1].time, trial.time - 1e-9)
    np.testing.assert_array_equal(trial.q, arm_log.trials[1].q[at])


def test_clipped_and_quantised_channels_are_named(
    edited: Callable[[Callable[[dict], None]], Path], arm_log: Log, tmp_path: Path
) -> None:
    def clip(columns: dict) -> None:
        columns["tau.elbow"] = list(np.clip(3.0 * np.sin(0.05 * np.arange(400)), -2.0, 2.0))

    assert load_log(edited(clip)).trials[1].cleaning.clipped.keys() == {"tau.elbow"}
    long = replace(arm_log.trials[0], time=np.arange(2000) / 100.0, q=np.zeros((2000, 2)), q_cmd=None)
    tau = np.round(np.random.default_rng(0).normal(size=(2000, 2)), 1)
    log = replace(arm_log, trials=(replace(long, tau=tau), *arm_log.trials[1:]))
    report = load_log(save_log(log, tmp_path / "coarse")).trials[0].cleaning
    assert report.quantised["tau.shoulder"] == pytest.approx(0.1)


FAULTS: dict[str, tuple[Callable[[dict], None], str]] = {
    "missing column": (lambda c: c.pop("q.elbow"), "q.elbow: column is missing"),
    "half a group": (lambda c: c.pop("q_cmd.elbow"), "q_cmd.elbow: column is missing"),
    "no time": (lambda c: c.pop("time"), "time: column is missing"),
    "unknown joint": (lambda c: c.update({"q.wrist": c["q.elbow"]}), "q.wrist: names no joint"),
    "text": (lambda c: c["tau.elbow"].__setitem__(7, "oops"), "tau.elbow: is not numeric"),
    "NaN": (lambda c: c["q.elbow"].__setitem__(7, "nan"), "q.elbow: is nan in row 7"),
    "infinity": (lambda c: c["tau.elbow"].__setitem__(9, "inf"), "tau.elbow: is inf in row 9"),
    "clock reset": (lambda c: c.update(time=[float(t) % 2.0 for t in c["time"]]), "time: goes back"),
    "too short": (
        lambda c: [values.__delitem__(slice(5, None)) for values in c.values()],
        "time: has 5 distinct",
    ),
}


@pytest.mark.parametrize("fault", list(FAULTS))
def test_a_faulty_trial_is_one_clear_line(
    fault: str, edited: Callable[[Callable[[dict], None]], Path]
) -> None:
    change, message = FAULTS[fault]
    folder = edited(change)
    with pytest.raises(LogError) as caught:
        load_log(folder)
    assert message in str(caught.value)
    assert str(folder / "two.csv") in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.remedy


HEADER_FAULTS: dict[str, tuple[dict, str]] = {
    "schema": ({"schema": "excite.log/9"}, "schema"),
    "unknown field": ({"colour": "blue"}, "colour"),
    "no joints": ({"joints": []}, "joints"),
    "joint twice": ({"joints": ["elbow", "elbow"]}, "'elbow' stands twice"),
    "unknown joint": ({"joints": ["shoulder", "wrist"]}, "no joint 'wrist'"),
    "unknown effect": ({"modelled": ["rigid_body", "magic"]}, "unknown name 'magic'"),
    "two bodies": ({"modelled": ["rigid_body", "rigid_body_fixed"]}, "modelled"),
    "no model": ({"robot": "other.urdf"}, "no such file 'other.urdf'"),
    "no torque": ({"torque": None}, "torque: is missing"),
    "rate": ({"rate_hz": 0}, "rate_hz"),
    "no trials": ({"trials": []}, "trials"),
    "trial file": ({"trials": [{"file": "none.csv", "role": "identification"}]}, "no such file"),
    "format": ({"trials": [{"file": "log.yaml", "role": "identification"}]}, "unknown format '.yaml'"),
    "role": ({"trials": [{"file": "two.csv", "role": "training"}]}, "trials.0.role"),
    "repeats": (
        {"trials": [{"file": "two.csv", "role": "validation", "repeats": "x.csv"}]},
        "no trial of this log",
    ),
    "gains": ({"controller": {"kp": {"wrist": 3.0}}}, "controller.kp"),
    "coupled joint": ({"coupling": {"elbow": {"wrist": 1.0}}}, "coupling: unknown joint 'wrist'"),
    "coupled both": (
        {"coupling": {"elbow": {"shoulder": 1.0}, "shoulder": {"elbow": 1.0}}},
        "coupling: has no inverse",
    ),
    "floating": ({"base": "floating"}, "base_link, wrench: are missing"),
}


@pytest.mark.parametrize("fault", list(HEADER_FAULTS))
def test_a_faulty_header_is_one_clear_line(fault: str, arm_log: Log, tmp_path: Path) -> None:
    changes, message = HEADER_FAULTS[fault]
    folder = save_log(arm_log, tmp_path / "log")
    change_header(folder, **changes)
    with pytest.raises(ExciteError) as caught:
        load_log(folder)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 4


def test_files_that_are_no_header(tmp_path: Path, g1: Robot, arm_log: Log) -> None:
    with pytest.raises(LogError, match="no such file"):
        load_log(tmp_path)
    (tmp_path / "log.yaml").write_text("a: [1")
    with pytest.raises(LogError, match="not valid YAML"):
        load_log(tmp_path)
    (tmp_path / "log.yaml").write_text("just words")
    with pytest.raises(LogError, match="not a mapping"):
        load_log(tmp_path)
    folder = save_log(arm_log, tmp_path / "log")
    with pytest.raises(LogError, match="no joint 'shoulder'"):
        load_log(folder, g1)


def test_nominal_robot_of_a_bare_urdf(arm_log: Log, tmp_path: Path) -> None:
    folder = save_log(arm_log, tmp_path / "log")
    change_header(folder, gravity=[0.0, 9.81, 0.0])
    robot = nominal_robot(load_log(folder))
    assert robot.joint_names == ("shoulder", "elbow")
    assert robot.mass == pytest.approx(3.0)
    np.testing.assert_array_equal(robot.model.gravity.linear, [0.0, 9.81, 0.0])
    with pytest.raises(LogError, match="made in memory"):
        nominal_robot(arm_log)
