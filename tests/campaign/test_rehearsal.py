"""Rehearsal without a load: what a standing robot's motion does in simulation decides whether it is safe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import excite
from excite.campaign.rehearsal import AT_LIMIT, MOST_SLIP_M, rehearse_alone, rehearse_motions
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.checks.joints import drive_torques
from excite.safety.checks.sweep import Sweep


@pytest.fixture(scope="module")
def squat(g1: Robot) -> Motion:
    return next(motion for motion in excite.load_motions("g1") if motion.metadata.generator == "squat")


def test_check_says_what_a_motion_did_in_simulation(g1: Robot, squat: Motion) -> None:
    report = excite.check(g1, [squat])
    (entry,) = report.to_json()["motions"]
    said = entry["rehearsal"]
    assert report.safe and list(said) == ["stands", "slip_m", "touches", "drive_share"]
    assert said["stands"] and not said["touches"]
    assert 0.0 <= said["slip_m"] < MOST_SLIP_M and 0.2 < said["drive_share"] < 1.0


def test_an_arm_is_not_rehearsed_nor_is_what_is_unsafe_anyway(g1: Robot, squat: Motion) -> None:
    faster = replace(squat, time=0.3 * squat.time, v=squat.v / 0.3, a=squat.a / 0.09)
    for report in (excite.check("jaco2", excite.load_motions("jaco2")[:1]), excite.check(g1, [faster])):
        assert "rehearsal" not in report.to_json()["motions"][0]


def test_a_drive_at_its_limit_without_a_load_refuses_the_motion(g1: Robot, squat: Motion) -> None:
    """Inverse dynamics leave the ankles a tenth; servos that hold the robot on soles need half as much again."""
    torque = g1.limits.torque.copy()
    ankles = [g1.joint_index(f"{side}_ankle_pitch_joint") for side in ("left", "right")]
    torque[ankles] = 1.1 * np.abs(drive_torques(Sweep(g1, squat))).max(axis=0)[ankles].max()
    weak = replace(g1, limits=replace(g1.limits, torque=torque))
    assert check_motion(weak, squat).safe
    alone = rehearse_alone(weak, squat)
    assert alone.stands and alone.drive_share >= 1.0 and alone.refused is not None
    report = excite.check(weak, [squat])
    (verdict,) = report.verdicts
    assert not report.safe and verdict.reason.startswith(f"{AT_LIMIT} of ")
    assert verdict.violations[0].limit == torque[g1.joint_index(verdict.violations[0].where)]
    (refused,) = rehearse_motions(weak, [squat], load=0.001)
    assert refused is not None and refused.reason == AT_LIMIT


def test_a_slip_of_more_than_a_centimetre_refuses_the_motion(g1: Robot, squat: Motion) -> None:
    """Soles on ice: what stands there by friction no longer does."""
    icy = replace(g1, feet=tuple(replace(foot, friction=0.02) for foot in g1.feet), hash="ice")
    sideways = next(m for m in excite.load_motions("g1") if m.metadata.generator == "random_joint")
    found = rehearse_alone(icy, sideways)
    assert found.refused is not None
    assert found.slip_m > MOST_SLIP_M or not found.stands
