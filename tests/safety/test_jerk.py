"""Jerk: from sample to sample, between setpoints, from and to rest; and what motions of one's own keep of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import ruckig

from excite.motion.files import load_motion
from excite.motion.generators.mixture import plan_candidates
from excite.motion.motion import Motion, jerk_peaks
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.filter import filter_candidates
from excite.safety.verdict import Verdict

JOINT = "wrist_1_joint"
SHARED = Path(__file__).resolve().parents[3] / "shared" / "cases"


def one_joint(arm: Robot, time: np.ndarray, moved: list[np.ndarray]) -> Motion:
    """A motion of one joint about rest, by its position, velocity and acceleration ``(n,)``."""
    shape = (len(time), arm.n_joints)
    q, v, a = np.tile(arm.rest, (len(time), 1)), np.zeros(shape), np.zeros(shape)
    for values, more in zip((q, v, a), moved, strict=True):
        values[:, arm.joint_index(JOINT)] += more
    return Motion("made", arm.name, arm.joint_names, time, q, v, a)


def switched(arm: Robot, hard: float, rate_hz: float, wait_s: float = 0.1) -> Motion:
    """Still, one acceleration, its opposite, still: values that hold from a sample to the next."""
    held, pause = np.full(round(0.3 * rate_hz), hard), np.zeros(round(wait_s * rate_hz))
    a = np.concatenate([pause, held, -held, pause, [0.0]])
    h = 1.0 / rate_hz
    v = np.concatenate([[0.0], np.cumsum(a[:-1]) * h])
    q = np.concatenate([[0.0], np.cumsum(v[:-1] * h + 0.5 * a[:-1] * h * h)])
    return one_joint(arm, np.arange(len(a)) * h, [q, v, a])


def jerks(verdict: Verdict) -> list[float]:
    return [v.value or 0.0 for v in verdict.violations if v.kind == "joint_jerk"]


@pytest.mark.parametrize("rate_hz", [100.0, 125.0, 500.0, 1000.0])
@pytest.mark.parametrize("wait_s", [0.0, 0.1])
def test_an_acceleration_that_switches_is_not_safe(arm: Robot, rate_hz: float, wait_s: float) -> None:
    """A start at 3 rad/s² is 3 rad/s² times the rate, whether the robot stands before or the motion begins there."""
    verdict = check_motion(arm, switched(arm, 3.0, rate_hz, wait_s))
    assert jerks(verdict) == [pytest.approx(3.0 * rate_hz)]
    assert not verdict.safe
    assert verdict.margins.joint_jerk_rad_s3 == pytest.approx(160.0 - 6.0 * rate_hz)


def test_a_recorded_reversal_at_nineteen_times_the_limit_is_not_safe(arm: Robot) -> None:
    file = SHARED / "jerk" / "jump.parquet"
    if not file.is_file():
        pytest.skip("no shared data")
    verdict = check_motion(arm, load_motion(file, arm))
    assert [(v.kind, v.where) for v in verdict.violations] == [("joint_jerk", JOINT)]
    assert verdict.margins.joint_jerk_rad_s3 == pytest.approx(160.0 - 3000.0)


@pytest.mark.parametrize("decimals", [6, 9])
def test_positions_alone_tell_a_switch_and_rounding_is_none(
    arm: Robot, decimals: int, tmp_path: Path
) -> None:
    """Six decimals at 500 Hz are some 500 rad/s³ from sample to sample, three times the limit."""
    time = np.arange(1001) / 500.0
    wave = 0.2 * (0.375 - 0.5 * np.cos(np.pi * time) + 0.125 * np.cos(2.0 * np.pi * time))
    smooth = one_joint(arm, time, [wave, np.zeros_like(wave), np.zeros_like(wave)])
    found = []
    for motion in (smooth, switched(arm, 3.0, 500.0)):
        names = ",".join(["time", *(f"q.{joint}" for joint in arm.joint_names)])
        path = tmp_path / "positions.csv"
        values = np.column_stack([motion.time, motion.q])
        np.savetxt(path, values, f"%.{decimals}f", ",", header=names, comments="")
        found.append(jerks(check_motion(arm, load_motion(path, arm))))
    assert found[0] == []
    assert len(found[1]) == 1 and found[1][0] > 160.0


@pytest.mark.parametrize("rate_hz", [125.0, 500.0])
def test_the_fastest_way_at_the_limit_is_safe_and_a_twentieth_more_is_not(arm: Robot, rate_hz: float) -> None:
    """ruckig's profiles use all of a jerk limit; samples hold where it switches only by chance."""
    for share, safe in ((1.0, True), (1.05, False)):
        problem, trajectory = ruckig.InputParameter(1), ruckig.Trajectory(1)
        problem.current_position, problem.target_position = [0.0], [0.8]
        problem.max_velocity, problem.max_acceleration, problem.max_jerk = [1.5], [6.0], [share * 160.0]
        ruckig.Ruckig(1).calculate(problem, trajectory)
        time = np.arange(int(np.ceil(trajectory.duration * rate_hz)) + 1) / rate_hz
        states = np.array([trajectory.at_time(t) for t in time])[:, :3, 0]
        verdict = check_motion(arm, one_joint(arm, time, list(states.T)))
        assert verdict.safe is safe, verdict.reason


@pytest.mark.parametrize(("share", "safe"), [(0.99, True), (1.01, False)])
def test_between_setpoints_the_curve_is_judged(arm: Robot, share: float, safe: bool) -> None:
    """From rest to rest in one quintic the jerk is 60 of the way over the cube of the time, at both ends (and -30
    half-way); the accelerations at the setpoints themselves are zero.
    """
    step = 0.5
    way = share * 160.0 * step**3 / 60.0
    q = np.array([0.0, way, 0.0])
    verdict = check_motion(arm, one_joint(arm, step * np.arange(3.0), [q, 0.0 * q, 0.0 * q]))
    assert verdict.safe is safe, verdict.reason
    assert verdict.margins.joint_jerk_rad_s3 == pytest.approx(160.0 * (1.0 - share), abs=0.01)


def test_parts_of_a_chain_go_on_with_the_acceleration_they_have(arm: Robot) -> None:
    whole = switched(arm, 0.1, 500.0, 0.1)
    first, second = slice(0, 151), slice(150, None)
    parts = []
    for part, name, chain in ((first, "a", {"following": "b"}), (second, "b", {"previous": "a"})):
        cut = [values[part] for values in (whole.time, whole.q, whole.v, whole.a)]
        motion = Motion(name, arm.name, arm.joint_names, *cut)
        parts.append(replace(motion, metadata=replace(motion.metadata, **chain)))
    for motion in parts:
        assert check_motion(arm, motion, neighbours={one.name: one for one in parts}).safe


@pytest.mark.parametrize("name", ["talos", "so101"])
def test_motions_of_our_own_keep_it_between_their_samples(name: str) -> None:
    robot = load_robot(name)
    candidates = plan_candidates(robot, 10, np.random.SeedSequence(0))
    report = filter_candidates(robot, candidates)
    assert len(report.motions) >= 8
    for motion in report.motions:
        parts = (motion.joint_positions(), motion.joint_velocities(), motion.joint_accelerations())
        assert (jerk_peaks(motion.time, *parts) <= robot.limits.jerk).all(), motion.name
