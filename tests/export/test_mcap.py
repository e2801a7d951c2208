"""MCAP files, read back by the libraries of MCAP itself."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from excite.export.export import export_motion
from excite.motion.motion import Motion
from excite.robot.robot import Robot

pytestmark = pytest.mark.usefixtures("readers_here")

ROBOT = "ur10"

mcap_reader = pytest.importorskip("mcap.reader")
mcap_ros2 = pytest.importorskip("mcap_ros2.decoder")


def read(path: Path):
    """Decoded messages by topic, with their times, and the metadata records."""
    with path.open("rb") as stream:
        reader = mcap_reader.make_reader(stream, decoder_factories=[mcap_ros2.DecoderFactory()])
        found: dict[str, list] = {}
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, schema.name, decoded))
        records = {record.name: record.metadata for record in reader.iter_metadata()}
    return found, records


def numbers(trajectory, field: str) -> list[list[float]]:
    return [list(getattr(point, field)) for point in trajectory.points]


@pytest.mark.parametrize("format", ["ros2", "mcap"])
def test_the_library_of_mcap_reads_the_trajectory(
    format: str, arm: Robot, motion: Motion, tmp_path: Path
) -> None:
    path = export_motion(motion, arm, format, tmp_path / "first")
    file = path if path.is_file() else path / "first.mcap"
    found, records = read(file)
    ((_, kind, trajectory),) = found["/joint_trajectory_controller/joint_trajectory"]
    assert kind == "trajectory_msgs/msg/JointTrajectory"
    assert trajectory.joint_names == list(motion.joint_names)
    np.testing.assert_array_equal(numbers(trajectory, "positions"), motion.q)
    np.testing.assert_array_equal(numbers(trajectory, "velocities"), motion.v)
    np.testing.assert_array_equal(numbers(trajectory, "accelerations"), motion.a)
    text = json.dumps(records)
    assert "excite.verdict" in text and "ur10" in text


def test_states_are_streamed_at_the_motions_times(arm: Robot, motion: Motion, tmp_path: Path) -> None:
    path = export_motion(
        motion, arm, "mcap", tmp_path / "first", 100.0, settings={"topic": "/sim/joint_command"}
    )
    found, _ = read(path)
    states = found["/sim/joint_command"]
    assert all(kind == "sensor_msgs/msg/JointState" for _, kind, _ in states)
    assert [time for time, _, _ in states] == [k * 10**7 for k in range(len(states))]
    stamps = [state.header.stamp for _, _, state in states]
    assert [stamp.sec * 10**9 + stamp.nanosec for stamp in stamps] == [time for time, _, _ in states]
    ((_, _, trajectory),) = found["/joint_trajectory_controller/joint_trajectory"]
    np.testing.assert_array_equal(
        [state.position for _, _, state in states], numbers(trajectory, "positions")
    )
    np.testing.assert_array_equal(
        [state.velocity for _, _, state in states], numbers(trajectory, "velocities")
    )
    assert [file.name for file in tmp_path.iterdir()] == ["first.mcap"]
