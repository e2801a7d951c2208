"""Controller files: what was written is read back by other means than what wrote it."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.atomic import atomic_folder
from excite.errors import InputError, MotionError, UnknownNameError
from excite.export.export import export_motion, export_motions, on_grid
from excite.export.registry import EXPORTERS
from excite.motion.collection import library_folder
from excite.motion.files import load_motion, save_motion
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from tests.export.test_clearance import examples, runs
from tests.safety.motions import smooth, standing_motion

pytestmark = pytest.mark.usefixtures("judged_once", "readers_here")


@pytest.fixture(scope="module")
def motion(g1: Robot) -> Motion:
    """0.503 s from rest to rest at an uneven rate: the pelvis goes down by 1 cm, an elbow bends; both feet stand."""
    step = smooth(np.linspace(0.0, 1.0, 61))
    pelvis = np.column_stack([0.0 * step, 0.0 * step, -0.01 * step])
    moved = standing_motion(g1, pelvis, {"right_elbow_joint": 0.1 * step}, rate_hz=60 / 0.503)
    # The spline's derivatives at the ends are zero to rounding; here they are to the bit.
    v, a = moved.v.copy(), moved.a.copy()
    v[[0, -1]] = a[[0, -1]] = 0.0
    return replace(moved.renamed("rise"), v=v, a=a)


def _read_bag(path: Path):
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        joints = [c for c in reader.connections if c.topic == "/joint_trajectory_controller/joint_trajectory"]
        ((connection, _, raw),) = list(reader.messages(connections=joints))
        return connection.topic, connection.msgtype, reader.deserialize(raw, connection.msgtype)


@pytest.mark.parametrize("format", sorted(EXPORTERS))
def test_every_format_writes_the_same_bytes_twice_and_replaces(format, motion, g1, tmp_path):
    kind = EXPORTERS[format]
    assert kind.name == format and kind.summary
    robot, moved, rate = g1, motion, kind.rates_hz[0] if kind.rates_hz else 100.0
    if not runs(format, g1, motion):
        arms = [(robot, _a_move(robot)) for robot in map(load_robot, ("ur10", "panda"))]
        robot, moved = next((its, motion) for its, motion in arms if runs(format, its, motion))
    reason = None if check_motion(robot, moved).safe else "a test"
    first, again, once_more = (
        export_motion(
            moved,
            robot,
            format,
            tmp_path / folder / "rise",
            rate_hz=rate,
            unsafe_anyway=reason,
            settings=examples(format),
        )
        for folder in ("a", "b", "b")
    )
    assert again == once_more
    assert _bytes(first) == _bytes(again) != {}
    beside = [f"{again.name}.unsafe.json"] if reason else []
    assert sorted(path.name for path in (tmp_path / "b").iterdir()) == [again.name, *beside]


def _a_move(robot: Robot) -> Motion:
    """A ready motion of a robot."""
    file = sorted((library_folder(robot.name) / "motions").glob("random_joint_*.parquet"))[0]
    return load_motion(file, robot)


def _bytes(path: Path) -> dict[str, bytes]:
    if path.is_file():
        return {"": path.read_bytes()}
    return {file.name: file.read_bytes() for file in path.rglob("*") if file.is_file()}


def test_csv_has_a_header_and_all_digits(motion, g1, tmp_path):
    path = export_motion(motion, g1, "csv", tmp_path / "rise.csv")
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0])[:2] == ["time", "base.px"]
    for i, joint in enumerate(g1.joint_names):
        for prefix, values in (("q", motion.q[:, 7:]), ("v", motion.v[:, 6:]), ("a", motion.a[:, 6:])):
            np.testing.assert_array_equal([float(row[f"{prefix}.{joint}"]) for row in rows], values[:, i])


@pytest.mark.parametrize("rate_hz", [50.0, 333.0, 1000.0])
def test_the_grid_is_exact_and_its_derivatives_belong_together(rate_hz, motion, g1, tmp_path):
    with np.load(
        export_motion(motion, g1, "npz", tmp_path / "rise", rate_hz=rate_hz), allow_pickle=False
    ) as archive:
        time, q, v, a = (archive[name] for name in ("time", "q", "v", "a"))
        assert tuple(archive["joint_names"]) == g1.joint_names
    np.testing.assert_array_equal(time, np.arange(len(time)) / rate_hz)
    assert motion.duration <= time[-1] < motion.duration + 1.0 / rate_hz + 1e-9
    np.testing.assert_allclose(q[-1], motion.q[-1, 7:], atol=1e-12)
    # The last interval may hold the posture; before it, central differences of what is written.
    np.testing.assert_allclose((q[2:-1] - q[:-3]) * rate_hz / 2, v[1:-2], atol=2.0 / rate_hz)
    np.testing.assert_allclose((v[2:-1] - v[:-3]) * rate_hz / 2, a[1:-2], atol=60.0 / rate_hz)


def test_a_motion_that_ends_moving_is_not_held(motion, g1):
    moving = on_grid(_cut(motion, 31), g1, 100.0)
    assert moving.time[-1] == 0.25 and np.abs(moving.v[-1]).max() > 0.1
    held = on_grid(motion, g1, 100.0)
    assert held.time[-1] == 0.51 and not held.v[-1].any() and not held.a[-1].any()
    assert held.contacts["left_foot"].shape == held.time.shape


def _cut(motion: Motion, n: int) -> Motion:
    contacts = {name: flags[:n] for name, flags in motion.contacts.items()}
    return Motion(
        "cut",
        motion.robot,
        motion.joint_names,
        motion.time[:n],
        motion.q[:n],
        motion.v[:n],
        motion.a[:n],
        contacts,
    )


@pytest.mark.parametrize("rate_hz", [None, 125.0, 1000.0])
def test_ros2_bag_is_read_back_by_rosbags_to_the_nanosecond(rate_hz, motion, g1, tmp_path):
    path = export_motion(motion, g1, "ros2", tmp_path / "rise", rate_hz=rate_hz)
    topic, msgtype, message = _read_bag(path)
    assert (topic, msgtype) == (
        "/joint_trajectory_controller/joint_trajectory",
        "trajectory_msgs/msg/JointTrajectory",
    )
    assert tuple(message.joint_names) == g1.joint_names
    expected = motion if rate_hz is None else on_grid(motion, g1, rate_hz)
    times = [p.time_from_start.sec * 10**9 + p.time_from_start.nanosec for p in message.points]
    if rate_hz is None:
        assert times == [round(t * 1e9) for t in motion.time]
    else:
        assert times == [k * 10**9 // int(rate_hz) for k in range(len(times))]
    for name, values in (
        ("positions", expected.joint_positions()),
        ("velocities", expected.joint_velocities()),
        ("accelerations", expected.joint_accelerations()),
    ):
        np.testing.assert_array_equal([getattr(point, name) for point in message.points], values)


def test_ros2_bag_holds_an_mcap_file(motion, g1, tmp_path):
    path = export_motion(motion, g1, "ros2", tmp_path / "rise")
    assert sorted(file.name for file in path.iterdir()) == ["metadata.yaml", "rise.mcap"]
    assert (path / "rise.mcap").read_bytes()[:8] == b"\x89MCAP0\r\n"


def test_unknown_format_names_the_known_ones(motion, g1, tmp_path):
    with pytest.raises(UnknownNameError) as caught:
        export_motion(motion, g1, "rosbag", tmp_path / "rise")
    assert caught.value.known == sorted(EXPORTERS)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("rate_hz", [0.0, -10.0, float("nan"), float("inf"), 1.0])
def test_bad_rates_are_refused_and_nothing_is_written(rate_hz, motion, g1, tmp_path):
    with pytest.raises(InputError) as caught:
        export_motion(motion, g1, "csv", tmp_path / "rise", rate_hz=rate_hz)
    assert caught.value.field == "rate_hz" and caught.value.remedy
    assert not list(tmp_path.iterdir())


def test_a_motion_of_another_robot_is_refused(motion, g1, tmp_path):
    other = Motion(
        "other", "arm", ("shoulder",), motion.time, motion.q[:, :1], motion.v[:, :1], motion.a[:, :1]
    )
    with pytest.raises(MotionError, match="not those of robot 'g1'"):
        export_motion(other, g1, "csv", tmp_path / "rise")


def test_a_folder_that_fails_half_way_leaves_the_old_one(tmp_path):
    with atomic_folder(tmp_path / "bag") as folder:
        folder.mkdir()
        (folder / "part").write_text("old")
    with pytest.raises(RuntimeError), atomic_folder(tmp_path / "bag") as folder:
        folder.mkdir()
        (folder / "part").write_text("new")
        raise RuntimeError
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]
    assert (tmp_path / "bag" / "part").read_text() == "old"


def test_files_and_folders_are_exported_under_their_names(motion, g1, tmp_path):
    for name in ("rise", "rise_again"):
        save_motion(motion.renamed(name), tmp_path / "plan" / "motions" / f"{name}.parquet")
    written = export_motions([tmp_path / "plan"], "npz", out=tmp_path / "out", rate_hz=50.0)
    assert written == [tmp_path / "out" / "rise.npz", tmp_path / "out" / "rise_again.npz"]
    assert all(path.is_file() for path in written)
    with pytest.raises(InputError, match="two motions are called 'rise'"):
        export_motions([tmp_path / "plan" / "motions" / "rise.parquet"] * 2, "npz", out=tmp_path / "out")
    with pytest.raises(UnknownNameError, match="unknown robot 'g2'"):
        export_motions([tmp_path / "plan"], "csv", out=tmp_path / "other", robot="g2")
    assert not (tmp_path / "other").exists()
