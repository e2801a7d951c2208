"""Blind cases without torque: the servo is the one that is said, and nothing of the torque is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from benchmarks.blind.arm_case import Servo, arm_of
from benchmarks.blind.documents import Answer, HiddenEffect
from excite.logs.header_blocks import TrialHeader
from excite.logs.log import Log, Trial
from excite.robot.loading import load_robot
from excite.simulation.execution import execute_motion
from excite.simulation.sensing import log_header

RATE = 200.0


@pytest.mark.parametrize(
    "servo",
    [Servo("inverse_dynamics"), Servo("gravity", follows_velocity=False, integral=2.0)],
    ids=["computed torque", "PID and weight, braking velocity"],
)
def test_the_motors_give_what_the_servo_says(servo: Servo) -> None:
    robot = load_robot("iiwa14")
    arm = arm_of(robot, True, np.random.default_rng(3))
    motion = arm.motions[0]
    short = motion.time <= 2.5
    motion = replace(motion, **{name: getattr(motion, name)[short] for name in ("time", "q", "v", "a")})
    recording = execute_motion(servo.on(replace(arm, motions=(motion,))).virtual, motion)
    drives, model, data = arm.virtual.drives, robot.model, robot.model.createData()
    q, v, c = recording.q, recording.v, recording.q_cmd
    error = c - q
    told = {
        "inverse_dynamics": lambda k: pin.rnea(model, data, c[k], motion.v[k], motion.a[k]),
        "gravity": lambda k: pin.computeGeneralizedGravity(model, data, q[k]),
    }[servo.feedforward]
    ahead = np.array([told(k) for k in range(len(q))])
    braked = (motion.v if servo.follows_velocity else 0.0) - v
    expected = drives.kp * error + drives.kd * braked + ahead
    rest = recording.tau_motor - expected
    # The integral began before the record, while the robot settled: its growth is what can be compared.
    wound = servo.integral * drives.kp * np.cumsum(error, axis=0) / RATE
    grown = rest - rest[0] - (wound - wound[0])
    assert np.abs(grown).max() < 0.01 * np.abs(recording.tau_motor).max()
    if servo.integral:
        assert np.abs(rest - rest[0]).max() > 0.05 * np.abs(recording.tau_motor).max()


@pytest.mark.parametrize("stated", [True, False])
def test_a_log_of_commands_says_no_more_than_it_should(stated: bool) -> None:
    robot = load_robot("iiwa14")
    header = log_header(robot, (TrialHeader(file="a.parquet", role="identification"),))
    zeros = np.zeros((5, 7))
    trial = Trial("a", "identification", np.arange(5.0), zeros, tau=zeros, q_cmd=zeros)
    log = Log(header=header, trials=(trial,), robot_text=robot.urdf)
    hidden = (HiddenEffect("torque_gain", "joint2", 1.2), HiddenEffect("encoder_offset", "joint4", 0.03))
    answer = Answer("double", "iiwa14", ("rigid_body_fixed",), hidden, 1.0)
    bare, left = Servo("gravity", integral=1.0, stated=stated).logged(log, answer)
    assert bare.header.torque == "none"
    assert bare.trials[0].tau is None
    # A servo that reckons weights from positions knows the true ones: its commands are not in the log's angles.
    assert bare.trials[0].q_cmd == pytest.approx(-np.eye(7)[3] * np.full((5, 1), 0.03))
    plain, _ = Servo("none", stated=stated).logged(log, answer)
    # Else the encoder that is off is its own, and the log's commands are off as well.
    assert plain.trials[0].q_cmd == pytest.approx(0.0)
    assert (left.kind, [item.effect for item in left.effects]) == ("single", ["encoder_offset"])
    said = bare.header.controller or {}
    assert said["mode"] == "position"
    if stated:
        assert said["ki"] == said["kp"] == (header.controller or {})["kp"]
        assert said["feedforward"] == "gravity"
    else:
        assert set(said) == {"mode"}
