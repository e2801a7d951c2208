"""Replays tell a robot that stands from one that falls, slips or hits itself."""

from __future__ import annotations

import pytest

from excite.robot.robot import Robot
from excite.simulation.replay import watched_run
from excite.simulation.virtual_robot import VirtualRobot, nominal_robot
from tests.simulation.motions import replay_motion, squatting, standing, waving


def test_a_quiet_stand_passes(g1: Robot) -> None:
    result = replay_motion(g1, standing(g1))
    assert result.on_its_feet
    assert result.max_slip_m < 1e-4
    assert result.max_tilt_rad < 0.01
    assert set(result.slip_m) == {"left_foot", "right_foot"}


@pytest.mark.parametrize("mass_error", [0.0, 0.15])
def test_a_squat_passes_on_the_model_and_on_a_changed_robot(
    g1: Robot, changed_g1: VirtualRobot, mass_error: float
) -> None:
    motion = squatting(g1, duration=2.0)
    for subject in (g1, changed_g1):
        result = replay_motion(subject, motion, mass_error=mass_error)
        assert result.on_its_feet
        assert result.max_slip_m < 0.005
        assert result.max_tracking_error_rad < 0.01


def test_leaning_over_falls_and_ends_early(g1: Robot) -> None:
    hips = {name: 1.2 for name in g1.joint_names if "hip_pitch" in name}
    result = replay_motion(g1, waving(g1, hips, duration=3.0))
    assert result.fell and not result.on_its_feet
    assert result.fell_at_s is not None and result.fell_at_s < 2.0


def test_an_arm_through_the_trunk_is_a_touch(g1: Robot) -> None:
    result = replay_motion(
        g1, waving(g1, {"left_shoulder_roll_joint": -0.6, "left_elbow_joint": 0.4}, duration=2.0)
    )
    assert result.self_collided and not result.fell


def test_a_slippery_floor_lets_the_feet_slip(g1: Robot) -> None:
    motion = squatting(g1, duration=2.0)
    assert (
        replay_motion(g1, motion, friction_error=-0.97).max_slip_m
        > 2.0 * replay_motion(g1, motion).max_slip_m
    )


def test_an_arm_that_follows_stays_up(panda: Robot) -> None:
    result = replay_motion(panda, waving(panda, {"panda_joint4": 0.3}, duration=1.0))
    assert result.on_its_feet and result.max_slip_m == 0.0
    assert result.max_tracking_error_rad < 0.03


@pytest.mark.parametrize("fault", ["slip", "touch", "none"])
def test_a_run_that_ends_at_its_first_fault_is_judged_as_a_whole_one(g1: Robot, fault: str) -> None:
    arm = {"left_shoulder_roll_joint": -0.6, "left_elbow_joint": 0.4}
    motion = waving(g1, arm, duration=2.0) if fault == "touch" else squatting(g1, duration=2.0)
    virtual = nominal_robot(g1)
    whole = watched_run(virtual, motion)
    assert whole.replay.self_collided == (fault == "touch")
    limit = 0.5 * whole.replay.max_slip_m if fault == "slip" else 2.0 * whole.replay.max_slip_m
    short = watched_run(virtual, motion, may_slip_m=limit)
    assert (short.replay.max_slip_m > limit) == (fault == "slip")
    assert short.replay.self_collided == (fault == "touch")
    n = len(short.recording.time)
    assert (n < len(whole.recording.time)) == (fault != "none")
    assert (short.recording.q == whole.recording.q[:n]).all()
