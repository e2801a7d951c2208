"""A robot that trots under a policy's soft servos: which drive is not as the simulator has it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import excite
from benchmarks.walking.servos import Fault, walk
from benchmarks.walking.steps import Steps
from benchmarks.walking.trot import trot
from excite.campaign.capture import capture_policy
from excite.errors import InputError, LogError
from excite.robot.robot import Robot


@pytest.fixture(scope="module")
def go2() -> Robot:
    return excite.load_robot("go2")


def test_a_weak_drive_a_late_one_and_a_worn_one_are_named_at_their_joints(go2: Robot) -> None:
    faults = (
        Fault("FL_calf_joint", strength=0.8),
        Fault("RR_hip_joint", late_s=0.015),
        Fault("RL_thigh_joint", dry=0.6),
    )
    found = excite.diagnose(trot(faults, seconds=9.0, seed=3), go2)
    sizes = {(one.effect, one.location): one.parameters for one in found.effects}
    assert found.verdict == "effect"
    assert set(sizes) == {
        ("torque_gain", "FL_calf_joint"),
        ("command_delay", "RR_hip_joint"),
        ("coulomb_friction", "RL_thigh_joint"),
    }
    assert sizes["torque_gain", "FL_calf_joint"]["delivered"].value == pytest.approx(0.8, abs=0.02)
    assert sizes["command_delay", "RR_hip_joint"]["delay"].value == pytest.approx(0.015, abs=0.002)
    assert sizes["coulomb_friction", "RL_thigh_joint"]["level"].value == pytest.approx(0.6, abs=0.1)
    gains = [one.value for one in found.absorbed if one.parameter == "kp"]
    assert gains == pytest.approx([40.0] * 12, rel=0.02)


def test_commands_the_imu_and_a_foot_are_named_where_they_are_off(go2: Robot) -> None:
    faults = (
        Fault("RL_thigh_joint", scale=0.75),
        Fault("FR_calf_joint", damping=1.8),
        Fault("RR_calf_joint", limit=14.0),
        Fault("FL_hip_joint", swapped="FR_hip_joint"),
        Fault(turned=(0.05, 0.08, -0.05)),
        Fault("FR", slippery=0.1),
        Fault(jitter_s=0.004),
    )
    found = excite.diagnose(trot(faults, seconds=13.0, seed=5), go2)
    sizes = {(one.effect, one.location): one.parameters for one in found.effects}
    assert set(sizes) == {
        ("command_scale", "RL_thigh_joint"),
        ("servo_damping", "FR_calf_joint"),
        ("torque_saturation", "RR_calf_joint"),
        ("joint_order", "FL_hip_joint"),
        ("joint_order", "FR_hip_joint"),
        ("imu_mounting", "imu"),
        ("foot_slip", "FR"),
        ("command_jitter", "command"),
        ("command_delay", "command"),
    }
    assert sizes["command_scale", "RL_thigh_joint"]["scale"].value == pytest.approx(0.75, abs=0.03)
    assert sizes["servo_damping", "FR_calf_joint"]["damping"].value == pytest.approx(1.8, abs=0.1)
    assert sizes["torque_saturation", "RR_calf_joint"]["limit"].value == pytest.approx(14.0, abs=0.3)
    assert sizes["command_jitter", "command"]["deviation"].value == pytest.approx(0.004, abs=0.0008)
    turned = [sizes["imu_mounting", "imu"][f"turn_{axis}"].value for axis in "xyz"]
    assert turned == pytest.approx([0.05, 0.08, -0.05], abs=0.015)
    assert any("FL_hip_joint follows the command of FR_hip_joint" in text for text in found.warnings)


def test_of_two_legs_the_one_that_is_weak_is_named_and_no_servo_of_a_joint_that_hardly_moves() -> None:
    # Wrists drown in the noise of torques; on two legs one that is weak looks like another that is strong.
    robot, rng = excite.load_robot("g1_no_ft"), np.random.default_rng(7)
    log = walk(Steps(robot, 9.0, rng), (Fault("left_hip_yaw_joint", strength=0.8),), rng)
    found = excite.diagnose(log, robot)
    named = {(one.effect, one.location): one.parameters for one in found.effects}
    assert (found.verdict, set(named)) == ("effect", {("torque_gain", "left_hip_yaw_joint")})
    assert named["torque_gain", "left_hip_yaw_joint"]["delivered"].value == pytest.approx(0.8, abs=0.02)
    damping = {one.joint: one.value for one in found.absorbed if one.parameter == "kd"}
    assert [kd for joint, kd in damping.items() if "hip" in joint or "waist" in joint] == pytest.approx(
        [6.0] * 9, rel=0.03
    )


def test_nothing_is_named_where_nothing_was_changed(go2: Robot) -> None:
    log = trot(seconds=9.0, seed=91)
    found = excite.diagnose(log, go2)
    assert (found.verdict, found.effects, found.next_experiment) == ("none", (), None)
    # Without torques the stated servo tells them; without its gains nothing does.
    bare = log.header.model_copy(update={"torque": "none", "controller": {"mode": "position"}})
    silent = replace(log, header=bare, trials=tuple(replace(t, tau=None) for t in log.trials))
    with pytest.raises(LogError, match="gains"):
        excite.diagnose(silent, go2)


def test_a_sheet_says_what_a_policy_is_recorded_with(go2: Robot, tmp_path: Path) -> None:
    sheet = capture_policy(go2, tmp_path / "policy.md")
    text = sheet.path.read_text(encoding="utf-8")
    assert all(word in text for word in ("q_cmd", "contact.RL", "rt/lowcmd", "500 Hz", "excite.capture/1"))
    assert [run.role for run in sheet.capture.motions] == ["identification", "validation"]
    with pytest.raises(InputError, match="feet"):
        capture_policy("ur10", tmp_path / "arm.md")
