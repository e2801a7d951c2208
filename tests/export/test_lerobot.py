"""LeRobot data sets: read back by pyarrow, by the conversion of recordings, and as motions."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from excite.conversion.sources.arrays import LeRobotSource
from excite.errors import MotionError
from excite.export.export import export_motion
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from tests.safety.motions import check_file

ROBOT = "panda"


@pytest.mark.parametrize("rate", [None, 50.0])
def test_actions_are_the_motion(rate: float | None, arm: Robot, motion: Motion, tmp_path: Path) -> None:
    path = export_motion(motion, arm, "lerobot", tmp_path / "set", rate)
    reference = export_motion(
        motion,
        arm,
        "npz",
        tmp_path / "same",
        rate or float(json.loads((path / "meta" / "info.json").read_text())["fps"]),
    )
    expected = np.load(reference)
    info = json.loads((path / "meta" / "info.json").read_text())
    assert info["codebase_version"] == "v3.0" and info["total_frames"] == len(expected["time"])
    place = info["data_path"].format(chunk_index=0, file_index=0, episode_chunk=0, episode_index=0)
    table = pq.read_table(path / place)
    assert set(table.column_names) == set(info["features"])
    for name, feature in info["features"].items():
        column = table[name]
        if feature["shape"] == [1]:
            assert str(column.type) == {"float32": "float", "int64": "int64"}[feature["dtype"]]
        else:
            assert column.type.list_size == feature["shape"][0] == len(feature["names"])
    q = expected["q"].astype(np.float32)
    np.testing.assert_array_equal(np.array(table["action"].to_pylist(), dtype=np.float32), q)
    np.testing.assert_array_equal(np.array(table["observation.state"].to_pylist(), dtype=np.float32), q)
    np.testing.assert_allclose(table["timestamp"].to_numpy(), expected["time"], rtol=1e-6)
    n = len(q)
    for name, value in (
        ("frame_index", range(n)),
        ("index", range(n)),
        ("episode_index", [0] * n),
        ("task_index", [0] * n),
    ):
        assert table[name].to_pylist() == list(value)
    (recording,) = LeRobotSource().read(path)
    (stream,) = recording.streams
    read = {column.channel + "." + column.label: column for column in stream.columns}
    for i, joint in enumerate(arm.joint_names):
        np.testing.assert_allclose(read[f"q_cmd.{joint}"].values, expected["q"][:, i], atol=1e-6)
    assert check_file(arm, path).safe


def test_what_version_3_says_of_episodes_and_tasks(arm: Robot, motion: Motion, tmp_path: Path) -> None:
    path = export_motion(motion, arm, "lerobot", tmp_path / "set", 50.0, settings={"task": "shake"})
    episode = pq.read_table(path / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    n = json.loads((path / "meta/info.json").read_text())["total_frames"]
    assert episode[0]["length"] == n and (
        episode[0]["dataset_from_index"],
        episode[0]["dataset_to_index"],
    ) == (0, n)
    assert (
        episode[0]["tasks"] == ["shake"]
        and episode[0]["data/chunk_index"] == episode[0]["data/file_index"] == 0
    )
    tasks = pq.read_table(path / "meta/tasks.parquet")
    assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["task"]
    assert tasks.to_pylist() == [{"task_index": 0, "task": "shake"}]
    stats = json.loads((path / "meta/stats.json").read_text())
    actions = np.array(pq.read_table(path / "data/chunk-000/file-000.parquet")["action"].to_pylist())
    np.testing.assert_allclose(stats["action"]["std"], actions.std(axis=0), rtol=1e-6)
    assert stats["timestamp"]["count"] == [n]


def test_damaged_data_sets_are_one_line(arm: Robot, motion: Motion, tmp_path: Path) -> None:
    path = export_motion(motion, arm, "lerobot", tmp_path / "set", 50.0)
    info = path / "meta" / "info.json"
    content = json.loads(info.read_text())
    for spoilt in (
        {**content, "fps": "x"},
        {"fps": 50},
        {**content, "features": {"action": {"names": ["a"]}}},
    ):
        info.write_text(json.dumps(spoilt))
        with pytest.raises(MotionError) as caught:
            load_motion(path, arm)
        assert "\n" not in str(caught.value)
    next((path / "data").glob("**/*.parquet")).write_bytes(b"PAR1")
    info.write_text(json.dumps(content))
    with pytest.raises(MotionError, match="cannot be read"):
        load_motion(path, arm)
