"""Every format ends in the same log: written by the format's own library, read by name."""

from __future__ import annotations

import gzip
import json
import lzma
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from scipy.io import savemat

import excite
from excite.conversion.explicit_mapping import Map
from excite.conversion.sources.registry import SOURCES, read_source
from excite.errors import LogError
from tests.conversion import written
from tests.conversion.written import JOINTS

pytestmark = pytest.mark.usefixtures("unexamined", "readers_here")

WHOLE = {"trials": {"validation": ["none"], "split": "none"}}


def text_table(
    separator: str, decimal: str = ".", *, comment: str = "", units: bool = False
) -> Callable[..., Path]:
    def write(folder: Path, data: dict[str, np.ndarray]) -> Path:
        names = ["time", *(f"{word}_{j}" for word in ("pos", "vel", "torque") for j in JOINTS)]
        lines = [comment] if comment else []
        lines.append(separator.join(names))
        if units:
            lines.append(separator.join(["s"] + ["rad"] * 3 + ["rad/s"] * 3 + ["Nm"] * 3))
        rows = np.column_stack([data["time"], data["q"], data["v"], data["tau"]])
        lines += [separator.join(f"{x:.10g}".replace(".", decimal) for x in row) for row in rows]
        file = folder / "table.csv"
        file.write_text("\n".join(lines) + "\n")
        return file

    return write


def parquet(folder: Path, data: dict[str, np.ndarray]) -> Path:
    columns = {"timestamp": data["time"]} | {f"joint_{k}": pa.array(data[k].tolist()) for k in ()}
    columns |= {
        "q": pa.array(data["q"].tolist()),
        "dq": pa.array(data["v"].tolist()),
        "tau": pa.array(data["tau"].tolist()),
    }
    pa.parquet.write_table(pa.table(columns), folder / "rows.parquet")
    return folder / "rows.parquet"


def npz(folder: Path, data: dict[str, np.ndarray]) -> Path:
    np.savez(folder / "arrays.npz", t=data["time"], qpos=data["q"], qvel=data["v"], qfrc_actuator=data["tau"])
    return folder / "arrays.npz"


def hdf5(folder: Path, data: dict[str, np.ndarray]) -> Path:
    with h5py.File(folder / "run.h5", "w") as file:
        file["observations/time"] = data["time"]
        file["observations/qpos"] = data["q"]
        file["observations/qvel"] = data["v"]
        file["observations/effort"] = data["tau"]
    return folder / "run.h5"


def mat(folder: Path, data: dict[str, np.ndarray]) -> Path:
    savemat(
        folder / "run.mat", {"log": {"t": data["time"], "q": data["q"], "qd": data["v"], "tau": data["tau"]}}
    )
    return folder / "run.mat"


def mat73(folder: Path, data: dict[str, np.ndarray]) -> Path:
    """Version 7.3 is HDF5 behind 512 bytes of words; matrices are transposed."""
    with h5py.File(folder / "run.mat", "w", userblock_size=512) as file:
        for name, values in (
            ("t", data["time"][None]),
            ("q", data["q"].T),
            ("qd", data["v"].T),
            ("tau", data["tau"].T),
        ):
            file[name] = values
    with (folder / "run.mat").open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512))
    return folder / "run.mat"


def json_columns(folder: Path, data: dict[str, np.ndarray]) -> Path:
    content = {"timestamp": data["time"], "position": data["q"], "velocity": data["v"], "effort": data["tau"]}
    (folder / "run.json").write_text(json.dumps({name: values.tolist() for name, values in content.items()}))
    return folder / "run.json"


def json_lines(folder: Path, data: dict[str, np.ndarray]) -> Path:
    rows = zip(data["time"], data["q"], data["v"], data["tau"], strict=True)
    lines = [json.dumps({"t": t, "q": list(q), "dq": list(v), "tau": list(tau)}) for t, q, v, tau in rows]
    (folder / "run.jsonl").write_text("\n".join(lines))
    return folder / "run.jsonl"


def pace(folder: Path, data: dict[str, np.ndarray]) -> Path:
    arrays = {"time": data["time"], "dof_pos": data["q"], "dof_vel": data["v"], "dof_torque": data["tau"]}
    return written.torch_file(folder / "chirp.pt", arrays)


def ros2(folder: Path, data: dict[str, np.ndarray]) -> Path:
    return written.ros2_bag(folder / "bag", data, mcap=False)


def mcap(folder: Path, data: dict[str, np.ndarray]) -> Path:
    return next(written.ros2_bag(folder / "bag", data, mcap=True).glob("*.mcap"))


def ros1(folder: Path, data: dict[str, np.ndarray]) -> Path:
    return written.ros1_bag(folder / "run.bag", data)


def ros1_in_mcap(folder: Path, data: dict[str, np.ndarray]) -> Path:
    """Messages of ROS 1 in MCAP, as bags are turned into it (schema encoding ``ros1msg``)."""
    from mcap.writer import Writer
    from rosbags.rosbag1 import Reader
    from rosbags.typesys import Stores, get_typestore

    bag = written.ros1_bag(folder / "run.bag", data)
    text, _ = get_typestore(Stores.ROS1_NOETIC).generate_msgdef("sensor_msgs/msg/JointState")
    with Reader(bag) as reader, (folder / "run.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros1")
        schema = writer.register_schema("sensor_msgs/JointState", "ros1msg", text.encode())
        topic = writer.register_channel("/joint_states", "ros1", schema)
        for _, time, message in reader.messages():
            writer.add_message(topic, time, bytes(message), time)
        writer.finish()
    return folder / "run.mcap"


def packed(opened: Any, suffix: str) -> Callable[..., Path]:
    """A table that was packed to save space."""

    def write(folder: Path, data: dict[str, np.ndarray]) -> Path:
        plain = text_table(",")(folder, data)
        file = folder / f"{plain.name}{suffix}"
        with opened(file, "wb") as stream:
            stream.write(plain.read_bytes())
        plain.unlink()
        return file

    return write


FORMATS = {
    "csv": text_table(","),
    "csv.gz": packed(gzip.open, ".gz"),
    "csv.xz": packed(lzma.open, ".xz"),
    "semicolons and decimal commas": text_table(";", ","),
    "tabs": text_table("\t"),
    "blanks": text_table("  "),
    "comment": text_table(",", comment="# robot 7, 2026-03-01"),
    "line of units": text_table(",", units=True),
    "parquet": parquet,
    "npz": npz,
    "hdf5": hdf5,
    "mat": mat,
    "mat 7.3": mat73,
    "json": json_columns,
    "json lines": json_lines,
    "pace": pace,
    "ros2": ros2,
    "mcap": mcap,
    "ros1": ros1,
    "ros 1 in mcap": ros1_in_mcap,
}


@pytest.fixture(scope="module")
def data() -> dict[str, np.ndarray]:
    return written.motion()


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written.arm_urdf(tmp_path_factory.mktemp("arm") / "arm.urdf")


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_ends_in_the_same_log(name, data, arm, tmp_path):
    source = FORMATS[name](tmp_path, data)
    found = excite.convert([source], arm, tmp_path / "log", Map.model_validate(WHOLE))
    trial = found.log.trials[0]
    assert found.log.header.joints == JOINTS
    np.testing.assert_allclose(trial.time - trial.time[0], data["time"], atol=1e-6)
    for attribute, channel in (("q", "q"), ("v", "v"), ("tau", "tau")):
        np.testing.assert_allclose(getattr(trial, attribute), data[channel], atol=1e-6)
    assert found.log.header.guessed


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_lerobot_episodes_are_trials(version, data, arm, tmp_path):
    source = written.lerobot(tmp_path / "set", data, version=version)
    found = excite.convert([source], arm, tmp_path / "log", Map(units={"q": "rad", "q_cmd": "rad"}))
    assert found.log.header.torque == "none"
    assert len(found.log.trials) == 2
    np.testing.assert_allclose(found.log.trials[1].q, data["q"][300:], atol=1e-6)
    np.testing.assert_allclose(found.log.trials[1].q_cmd, data["q_cmd"][300:], atol=1e-6)


def test_lerobot_states_may_hold_more_than_positions(data, arm, tmp_path):
    """As OpenArm's do: the ending of each name says what it is."""
    source = written.lerobot(tmp_path / "set", data, version="v3.0")
    file = next(source.glob("data/*/*.parquet"))
    table = pyarrow.parquet.read_table(file)
    state = np.hstack([data["q"], data["v"], data["tau"]])
    table = table.set_column(0, "observation.state", pa.array(state.tolist()))
    pyarrow.parquet.write_table(table, file)
    info = json.loads((source / "meta" / "info.json").read_text())
    endings = ("pos", "vel", "torque")
    names = [f"{joint}.{ending}" for ending in endings for joint in JOINTS]
    info["features"]["observation.state"] = {"dtype": "float32", "shape": [9], "names": names}
    (source / "meta" / "info.json").write_text(json.dumps(info))
    found = excite.convert([source], arm, tmp_path / "log", Map(units={"q": "rad", "q_cmd": "rad"}))
    trial = found.log.trials[1]
    for attribute in ("q", "v", "tau"):
        np.testing.assert_allclose(getattr(trial, attribute), data[attribute][300:], atol=1e-6)


def test_joint_states_without_effort_have_no_torque(data, arm, tmp_path):
    from rosbags.rosbag2 import Writer

    store = written.ros2_store()
    with Writer(tmp_path / "bag", version=9) as bag:
        topic = bag.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for time, message in written.joint_states(store, data, np.random.default_rng(3), effort=False):
            bag.write(topic, round(time * 1e9), store.serialize_cdr(message, "sensor_msgs/msg/JointState"))
    found = excite.convert([tmp_path / "bag"], arm, tmp_path / "log", Map.model_validate(WHOLE))
    assert found.log.header.torque == "none"
    np.testing.assert_allclose(found.log.trials[0].q, data["q"], atol=1e-9)


@pytest.mark.parametrize(
    "content", [b"", b"\0" * 300, b"PK\x03\x04 no archive", b"\x89HDF\r\n\x1a\n", b"hello\nworld\n"]
)
@pytest.mark.parametrize(
    "suffix", [".csv", ".npz", ".h5", ".mat", ".json", ".bag", ".mcap", ".pt", ".parquet", ".db3"]
)
def test_what_is_no_such_file_is_one_line(content, suffix, tmp_path):
    file = tmp_path / f"bad{suffix}"
    file.write_bytes(content)
    with pytest.raises(LogError) as error:
        read_source(file)
    assert str(file) in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["run.csv.gz", "run.csv.xz", "run.csv.bz2", "run.mat.gz"])
def test_what_is_not_packed_as_it_says_is_one_line(name, tmp_path):
    file = tmp_path / name
    file.write_bytes(gzip.compress(b"t,q\n" * 400)[:-20] if name.endswith("csv.gz") else b"nothing packed")
    with pytest.raises(LogError, match="cannot be unpacked") as error:
        read_source(file)
    assert str(file) in str(error.value) and "\n" not in str(error.value)


def test_an_error_within_a_packed_file_names_it(tmp_path):
    file = tmp_path / "run.csv.gz"
    file.write_bytes(gzip.compress(b"hello\nworld\n"))
    with pytest.raises(LogError) as error:
        read_source(file)
    assert str(error.value).startswith(f"{file}:") and error.value.source == file


def test_a_pickle_that_names_anything_else_is_not_run(tmp_path):
    class Evil:
        def __reduce__(self):
            return (Path.write_text, (tmp_path / "done", "harm"))

    with zipfile.ZipFile(tmp_path / "evil.pt", "w") as archive:
        archive.writestr("archive/data.pkl", pickle.dumps({"time": Evil()}, protocol=2))
    with pytest.raises(LogError, match="no plain data"):
        read_source(tmp_path / "evil.pt")
    assert not (tmp_path / "done").exists()


def test_all_formats_are_in_the_registry():
    assert {SOURCES[name].name for name in SOURCES} == set(SOURCES)
