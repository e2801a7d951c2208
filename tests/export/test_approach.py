"""The way from rest and back: checked with the motion, round the robot's own bodies, or refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.errors import InputError, UnsafeMotionError
from excite.export.export import export_motion, with_approach
from excite.motion.collection import library_folder
from excite.motion.files import load_motion
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.checks.joints import drive_torques
from excite.safety.checks.sweep import Sweep
from excite.safety.repairs.sampling import plan_transfer
from tests.safety.motions import check_file


@pytest.fixture(scope="module")
def arm() -> Robot:
    return load_robot("ur10")


def moved_to(robot: Robot, end: np.ndarray, start: np.ndarray, name: str = "away") -> Motion:
    """A motion from rest to rest between two postures, neither of them the robot's own."""
    part = plan_transfer(robot, start, end, 125.0)
    return Motion(name, robot.name, robot.joint_names, 3.0 + part.time, part.q, part.v, part.a)


@pytest.fixture(scope="module")
def away(arm: Robot) -> Motion:
    start = arm.rest + np.array([0.5, -0.2, 0.3, 0.1, -0.4, 1.0])
    return moved_to(arm, start + 0.1, start)


def test_the_file_starts_and_ends_at_rest_and_holds_the_motion_in_between(
    arm: Robot, away: Motion, tmp_path: Path
) -> None:
    path = export_motion(away, arm, "csv", tmp_path / "away", approach=True)
    assert check_file(arm, path).safe
    led = load_motion(path, arm)
    np.testing.assert_allclose(led.q[[0, -1]], [arm.rest, arm.rest], atol=1e-12)
    assert not led.v[[0, -1]].any() and led.time[0] == 0.0
    at = int(np.argmin(np.abs(led.q - away.q[0]).max(axis=1)))
    np.testing.assert_array_equal(led.q[at : at + away.n_samples], away.q)
    np.testing.assert_array_equal(led.a[at : at + away.n_samples], away.a)
    np.testing.assert_allclose(np.diff(led.time), 1 / 125, rtol=1e-9)


def test_a_motion_that_starts_at_rest_is_the_same_with_and_without(arm: Robot, tmp_path: Path) -> None:
    motion = load_motion(library_folder("ur10") / "motions" / "random_joint_015.parquet", arm)
    assert with_approach(arm, motion) is motion


@pytest.mark.parametrize("size", [0.3, 0.02, 1e-3, 1e-6])
def test_ways_of_any_length_keep_their_share_of_the_limits(size: float, arm: Robot) -> None:
    way = size * np.array([1.0, -0.3, 0.2, 0.0, 0.5, 1.0])
    part = plan_transfer(arm, arm.rest, arm.rest + way, 125.0)
    assert (np.abs(part.v) <= 0.501 * arm.limits.velocity).all()
    assert (np.abs(part.a) <= 0.501 * arm.limits.acceleration).all()
    np.testing.assert_allclose(part.q[-1], arm.rest + way, atol=1e-12)
    assert not part.v[-1].any()


def test_a_slower_way_is_the_same_way_run_slower(arm: Robot, away: Motion) -> None:
    """Where the drives are too weak for half of the limits: velocities and accelerations belong to the positions."""
    usual = with_approach(arm, away)
    peak = np.abs(drive_torques(Sweep(arm, usual))).max(axis=0)
    held = np.abs(drive_torques(Sweep(arm, away))).max(axis=0)
    weak = replace(arm, limits=replace(arm.limits, torque=np.maximum(1.02 * held, 0.97 * peak)))
    slow = with_approach(weak, away)
    assert check_motion(weak, slow).safe and not check_motion(weak, usual).safe
    assert slow.duration - away.duration > 1.8 * (usual.duration - away.duration)
    np.testing.assert_allclose(np.gradient(slow.v, slow.time, axis=0), slow.a, atol=0.2)
    np.testing.assert_allclose(np.gradient(slow.q, slow.time, axis=0), slow.v, atol=0.005)


def test_an_unsafe_way_does_not_leave(arm: Robot, away: Motion, tmp_path: Path) -> None:
    # Its end is beyond the range: no way there is safe, nor is the motion.
    out = away.q[-1].copy()
    out[0] = arm.limits.position_upper[0] + 0.1
    beyond = moved_to(arm, out, away.q[0], "beyond")
    with pytest.raises(UnsafeMotionError, match="joint_position of shoulder_pan_joint"):
        export_motion(beyond, arm, "csv", tmp_path / "beyond", approach=True)
    broken = replace(away, q=np.where(away.time[:, None] > 3.2, np.nan, away.q))
    with pytest.raises(UnsafeMotionError, match="not_finite"):
        export_motion(broken, arm, "csv", tmp_path / "broken", approach=True)
    changed = replace(away, metadata=replace(away.metadata, stated_hash="00"))
    with pytest.raises(UnsafeMotionError, match="changed_since_written"):
        export_motion(changed, arm, "csv", tmp_path / "changed", approach=True)
    assert not list(tmp_path.iterdir())


def test_a_standing_robot_is_not_led_by_its_joints_alone(g1: Robot, tmp_path: Path) -> None:
    motion = load_motion(library_folder("g1") / "motions" / "squat_009.parquet", g1)
    n = motion.n_samples // 2
    late = replace(
        motion,
        time=motion.time[n:],
        q=motion.q[n:],
        v=motion.v[n:],
        a=motion.a[n:],
        contacts={name: flags[n:] for name, flags in motion.contacts.items()},
    )
    with pytest.raises(InputError, match="approach: starts away from rest") as caught:
        export_motion(late, g1, "csv", tmp_path / "late", approach=True)
    assert "\n" not in str(caught.value) and not list(tmp_path.iterdir())
