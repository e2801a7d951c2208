"""Logs without torque: the servo, and what is said."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.arrays import Array
from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.servo.gains import estimate_gains, known_servo, stated_servo
from excite.diagnosis.servo.servo import (
    Servo,
    ServoRecord,
    cycle_lag,
    delay_torques,
    read_signals,
    servo_floor,
    tracking_sentences,
)
from excite.errors import LogError
from excite.logs.files import load_log
from excite.logs.log import Log, LogHeader, Trial
from excite.logs.robot import nominal_robot
from excite.logs.signals.butterworth import central_differences, lowpass
from excite.regressor.kernels import inverse_dynamics
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from tests.diagnosis.few_trials import few_trials


def servo_of(log: Log, robot: Robot) -> tuple[Array, Array, float]:
    """Gains of the practice arms' servo and its error, from the torques that a command-only log does not have."""
    rate, rows = log.header.rate_hz, []
    for trial in log.role("identification"):
        q, c = (central_differences(lowpass(x, rate, 30.0), rate) for x in (trial.q, trial.q_cmd))
        model = inverse_dynamics(robot.model, c.value, c.first, c.second)
        made = (c.value - q.value, c.first - q.first, model, trial.tau)
        rows.append(np.stack([lowpass(x, rate, 12.0)[40:-40:4] for x in made], axis=2))
    stacked = np.concatenate(rows)
    found = [np.linalg.lstsq(x[:, :3], x[:, 3], rcond=None)[0] for x in stacked.transpose(1, 0, 2)]
    gains = np.array(found)
    return gains[:, 0], gains[:, 1], float(np.abs(gains[:, 2] - 1.0).max())


def without_torque(log: Log, controller: dict) -> Log:
    header = log.header.model_copy(update={"torque": "none", "controller": controller})
    return replace(log, header=header, trials=tuple(replace(t, tau=None) for t in log.trials))


def controller_of(log: Log, robot: Robot) -> dict:
    kp, kd, _ = servo_of(log, robot)
    joints = log.header.joints
    return {
        "mode": "position",
        "kp": dict(zip(joints, kp.tolist(), strict=True)),
        "kd": dict(zip(joints, kd.tolist(), strict=True)),
    }


def test_torque_is_rebuilt_from_gains_and_the_form_of_the_servo_found(gap_dir: Path):
    log = load_log(gap_dir / "arm" / "case_003")
    robot = nominal_robot(log)
    trial = log.trials[0]
    signals = {trial.name: read_signals(robot, log, trial)}
    servo = known_servo(robot, without_torque(log, controller_of(log, robot)), signals)
    assert (servo.feedforward, servo.follows_velocity) == ("inverse_dynamics", True)
    assert servo.estimated == ("the feedforward",)
    rebuilt, measured = (
        lowpass(x, 200.0, 10.0)[60:-60] for x in (signals[trial.name].servo_torque(servo), trial.tau)
    )
    assert ((rebuilt - measured).std(axis=0) < 0.05 * measured.std(axis=0)).all()


def test_gains_of_a_plain_servo_are_estimated(gap_dir: Path):
    """A servo without feedforward: commands are made for it from the record's own torques."""
    log = load_log(gap_dir / "arm" / "case_012")
    robot = nominal_robot(log)
    kp, kd = np.full(7, 150.0), np.full(7, 12.0)
    made = []
    for trial in log.role("identification")[:2]:
        q = central_differences(lowpass(trial.q, 200.0, 20.0), 200.0)
        tau = lowpass(trial.tau, 200.0, 12.0)
        command = np.array(trial.q)
        for k in range(1, len(command)):
            # kp (c − q) + kd (ċ − v) = τ for the command, implicitly.
            push = tau[k] + kp * q.value[k] + kd * q.first[k] + kd * 200.0 * command[k - 1]
            command[k] = push / (kp + kd * 200.0)
        made.append(replace(trial, q_cmd=command))
    plain = without_torque(log, {"mode": "position"})
    servo = known_servo(robot, plain, {t.name: read_signals(robot, log, t) for t in made})
    assert servo.feedforward == "none"
    # Joints that carry weight; the others' scale is that of a friction nobody measured.
    assert servo.kp[[1, 3]] == pytest.approx(kp[[1, 3]], rel=0.15)


@pytest.mark.parametrize("follows", [True, False])
def test_damping_is_found_under_the_encoders_noise(follows: bool):
    """An arm that follows slow sines, its torques from the nominal model: what the servo needed is known."""
    robot = load_robot("iiwa14")
    rng, rate = np.random.default_rng(3), 200.0
    kp = np.array([2000.0, 2000.0, 2000.0, 2000.0, 500.0, 500.0, 300.0])
    kd = 0.045 * kp
    joints = robot.joint_names
    header = LogHeader.model_validate(
        {
            "schema": "excite.log/1",
            "robot": "robot.urdf",
            "base": "fixed",
            "rate_hz": rate,
            "joints": list(joints),
            "torque": "none",
            "controller": {"mode": "position"},
            "modelled": ["rigid_body"],
            "trials": [{"file": "t.csv", "role": "identification"}],
        }
    )
    time = np.arange(3000) / rate
    frequency, phase = rng.uniform(0.6, 3.0, (3, 7)), rng.uniform(0.0, 6.0, (3, 7))
    q = 0.25 * np.sin(time[:, None, None] * frequency + phase).sum(axis=1)
    d = central_differences(q, rate)
    friction = 0.05 * kp / 500.0 * np.tanh(d.first / 0.01)
    tau = (
        inverse_dynamics(robot.model, d.value, d.first, d.second)
        + friction
        + (0.0 if follows else kd * d.first)
    )
    command = np.array(q)
    for k in range(1, len(q)):
        lead = kd * rate * (command[k - 1] - q[k - 1]) if follows else 0.0
        command[k] = q[k] + (tau[k] + lead) / (kp + (kd * rate if follows else 0.0))
    noisy = q + 6e-5 * rng.standard_normal(q.shape)
    trial = Trial("t", "identification", time, noisy, q_cmd=command)
    log = Log(header=header, trials=(trial,), robot_text=robot.urdf)
    servo = known_servo(robot, log, {"t": read_signals(robot, log, trial)})
    assert (servo.feedforward, servo.follows_velocity) == ("none", follows)
    assert servo.kp == pytest.approx(kp, rel=0.1)
    assert servo.kd == pytest.approx(kd, rel=0.15)
    # Stated gains, one of them wrong, hide none of it: the record tells the same beside them.
    wrong = kp * np.where(np.arange(7) == 3, 0.6, 1.0)
    way = {
        "velocity_reference": "q_cmd" if follows else "none",
        "drive": {joints[3]: "XM540-W270", joints[1]: "mit"},
    }
    said = {"kp": wrong.tolist(), "kd": kd.tolist(), "feedforward": "none", **way}
    beside = replace(log, header=header.model_copy(update={"controller": said}))
    signals = {"t": read_signals(robot, beside, trial)}
    told = {
        (g.parameter, g.joint): g for g in estimate_gains(robot, beside, known_servo(robot, beside, signals))
    }
    gain = told["kp", joints[3]]
    assert gain.given == pytest.approx(wrong[3])
    assert gain.size.value == pytest.approx(kp[3], rel=0.1)
    assert gain.interval90 is not None and gain.interval90[0] > wrong[3]
    assert gain.firmware_unit == "Position P Gain (84)"
    # P/128 of PWM per pulse, 4096 of them a turn, full at 885, and 10.6 N·m then.
    duty = gain.firmware / 128.0 * 4096.0 / (2.0 * np.pi) / 885.0
    assert duty * 10.6 == pytest.approx(gain.size.value, rel=1e-3)
    assert told["kd", joints[1]].firmware == told["kd", joints[1]].size.value
    assert told["kp", joints[0]].firmware is None


def test_a_log_without_commands_says_what_is_missing(gap_dir: Path):
    log = load_log(gap_dir / "arm" / "case_012")
    bare = without_torque(log, {"mode": "position"})
    bare = replace(bare, trials=tuple(replace(t, q_cmd=None) for t in bare.trials))
    with pytest.raises(LogError, match=r"no torque, no current and no command.*q_cmd"):
        diagnose(bare, nominal_robot(log))


def test_a_velocity_servo_is_refused(gap_dir: Path):
    log = load_log(gap_dir / "arm" / "case_012")
    with pytest.raises(LogError, match=r"controller\.mode.*no position servo"):
        diagnose(without_torque(log, {"mode": "velocity"}), nominal_robot(log))


@pytest.mark.slow
def test_command_only_payload_is_named_on_positions(gap_dir: Path, tmp_path: Path):
    log = few_trials(load_log(gap_dir / "arm" / "case_003"), 1)
    robot = nominal_robot(log)
    controller = controller_of(log, robot) | {"feedforward": "inverse_dynamics"}
    result = diagnose(without_torque(log, controller), robot, out=tmp_path)
    assert (result.verdict, result.effect, result.location) == ("effect", "payload", "link6")
    assert {c.unit for c in result.gap.per_channel.values()} == {"rad"}
    assert result.gap.after < 0.3 * result.gap.before
    assert result.simulation is not None and result.simulation.driven_by == "q_cmd"
    # Beside it stands what needs no physics, judged on the same rows.
    told = result.to_json()["trivial"]
    assert set(told) == set(result.gap.per_channel)
    for name, item in told.items():
        assert (item["unit"], item["model"]) == ("rad", result.gap.per_channel[name].after)
        assert 0.0 < max(item["fir"], item["delayed_command"]) < item["command"]
    assert (tmp_path / "augmented.xml").is_file()
    assert any("has no torque" in text for text in result.warnings)


@pytest.mark.slow
def test_unknown_torque_constants_are_said(gap_dir: Path):
    log = few_trials(load_log(gap_dir / "arm" / "case_003"), 1)
    robot = nominal_robot(log)
    ratio = np.array([2.0, 4.0, 3.0, 1.5, 0.7, 0.5])
    header = log.header.model_copy(update={"torque": "current"})
    trials = tuple(replace(t, current=t.tau / ratio, tau=None) for t in log.trials)
    known = header.model_copy(
        update={"torque_constants": dict(zip(header.joints, ratio.tolist(), strict=True))}
    )
    stated = diagnose(replace(log, header=known, trials=trials), robot)
    assert (stated.effect, stated.location) == ("payload", "link6")
    assert any("wrong constant is a torque_gain" in text for text in stated.warnings)
    guessed = diagnose(replace(log, header=header, trials=trials), robot)
    assert all(item.effect != "torque_gain" for item in guessed.effects)
    assert any("not stated and were estimated" in text for text in guessed.warnings)
    constants = [item for item in guessed.absorbed if item.parameter == "torque_constant"]
    assert constants and all(item.size.unit == "N·m/A" and item.interval90 is None for item in constants)


def test_the_servos_cycle_is_found_where_it_is_one(gap_dir: Path):
    """Torques taken early are late by as much; what is longer than a cycle is left to be named."""
    log = load_log(gap_dir / "arm" / "case_022")
    robot = nominal_robot(log)
    trials = list(log.trials)

    def found(early: float) -> float:
        moved = [replace(t, tau=delay_torques(t.time, t.tau, -early)) for t in trials]
        return cycle_lag(arm_samples(robot, log, moved), log.header.modelled)

    assert found(0.002) == pytest.approx(0.002, abs=5e-4)
    assert found(0.008) == pytest.approx(0.008, abs=1e-3)
    assert found(0.03) == 0.0


@pytest.mark.parametrize("lag", [0.0, 0.004])
def test_roll_outs_begin_with_the_servo_whose_torques_were_rebuilt(gap_dir: Path, lag: float):
    """On the record's own motion the drive asks for the torques that act; off it, it pulls back at once."""
    log = load_log(gap_dir / "arm" / "case_012")
    robot = nominal_robot(log)
    signals = read_signals(robot, log, log.trials[0])
    servo = Servo(np.linspace(300.0, 100.0, 7), np.linspace(40.0, 5.0, 7), "gravity", True)
    order = [4, 0, 2]
    drive = ServoRecord(servo, {"t": signals}, lag, {}, log.header.joints).make_drive("t", order)
    acts = signals.acting_torque(servo, lag)[:, order]
    q, v = signals.measured.value[:, order], signals.measured.first[:, order]
    at = range(200, 1800, 50)
    offered = drive.at_times(drive.time)
    assert drive.motor_torque(offered, q, v)[at] == pytest.approx(acts[at], abs=1e-9)
    pulled = drive.motor_torque(offered[300], q[300] + 0.01, v[300] + 0.1)
    assert pulled - acts[300] == pytest.approx(-0.01 * servo.kp[order] - 0.1 * servo.kd[order])


def test_one_gain_may_stand_for_all_joints():
    stated = stated_servo({"kp": 14.5, "kd": {"b": 2}, "velocity_reference": "none"}, ("a", "b"))
    assert stated.kp.tolist() == [14.5, 14.5]
    assert np.isnan(stated.kd[0]) and stated.kd[1] == 2.0
    assert stated.follows == (False,)
    assert stated.missing == ("kd of a", "the feedforward")
    assert stated_servo({"velocity_reference": "derivative of q_cmd"}, ("a",)).follows == (True,)
    assert stated_servo(None, ("a",)).follows == (True, False)
    assert stated_servo({"kp": [3, 4.5]}, ("a", "b")).kp.tolist() == [3.0, 4.5]


@pytest.mark.parametrize(
    ("controller", "what"),
    [
        ({"kp": {"a": "soft"}}, r"controller\.kp.*no number.*write one number"),
        ({"kp": [1.0, 2.0]}, r"controller\.kp.*no number.*one for each joint"),
        ({"mode": "torque"}, r"controller\.mode.*no position servo.*tau_cmd"),
        ({"kp": 3.0, "ki": {"a": 2.0}}, r"controller\.ki.*integral part.*tau_cmd"),
    ],
)
def test_a_controller_that_cannot_be_rebuilt_is_refused(controller: dict, what: str):
    with pytest.raises(LogError, match=what):
        stated_servo(controller, ("a",))


def test_what_hangs_and_what_sticks_is_measured(gap_dir: Path):
    """Commands made for a soft servo from the record's torques: half the kp, twice the sag and the dead band."""
    log = load_log(gap_dir / "arm" / "case_012")
    robot = nominal_robot(log)
    trials = log.role("identification")[:2]
    samples = arm_samples(robot, log, trials)
    baseline = fit_baseline(samples, log.header.modelled, spectral_floor(samples))

    def told(kp: float) -> list[dict[str, list[float]]]:
        soft = [replace(t, q_cmd=t.q + t.tau / kp) for t in trials]
        servo = Servo(np.full(7, kp), np.zeros(7), "none", True)
        signals = {t.name: read_signals(robot, log, t) for t in soft}
        hangs, band = tracking_sentences(baseline, ServoRecord(servo, signals, 0.0, {}, log.header.joints))
        assert "under its weight" in hangs and "dead band" in band
        found = (
            re.findall(r"(\w+) ([+-±]?[-+\d.]+) mrad(?: \(weight over kp: ([-+\d]+))?", x)
            for x in (hangs, band)
        )
        return [{name: [float(x.strip("±")) for x in sizes if x] for name, *sizes in one} for one in found]

    (stiff, firm), (soft, loose) = told(400.0), told(200.0)
    for joint, (hang, weight) in stiff.items():
        assert hang == pytest.approx(weight, rel=0.15, abs=1.0)
        assert soft[joint][0] == pytest.approx(2.0 * hang, abs=1.5)
    for joint, (band,) in firm.items():
        assert loose[joint][0] == pytest.approx(2.0 * band, abs=0.2)


@pytest.mark.slow
def test_commanded_torques_are_torques(gap_dir: Path):
    log = few_trials(load_log(gap_dir / "arm" / "case_003"), 1)
    robot = nominal_robot(log)
    asked = replace(
        without_torque(log, {"mode": "velocity"}),
        trials=tuple(replace(t, tau=None, tau_cmd=t.tau) for t in log.trials),
    )
    result = diagnose(asked, robot)
    assert (result.verdict, result.effect, result.location) == ("effect", "payload", "link6")
    assert any("tau_cmd" in text for text in result.warnings)


def test_noise_of_a_servos_torque_grows_with_the_frequency(gap_dir: Path):
    """Encoders with white noise on a robot that stands: what the floor says, against what is there."""
    log = load_log(gap_dir / "arm" / "case_012")
    robot = nominal_robot(log)
    rng = np.random.default_rng(2)
    servo = Servo(np.full(7, 800.0), np.full(7, 60.0), "none", True)
    made = []
    for trial in log.trials[:2]:
        still = np.tile(robot.rest, (len(trial.time), 1))
        noisy = replace(trial, q=still + 3e-5 * rng.standard_normal(still.shape), q_cmd=still)
        made.append(replace(noisy, tau=read_signals(robot, log, noisy).servo_torque(servo)))
    samples = arm_samples(robot, log, made)
    there = samples.to_rows([t.tau for t in samples.trials]).std(axis=0)
    assert servo_floor(samples, servo, list(range(7))) == pytest.approx(there, rel=0.15)
    # A floor that takes the noise for white is three times too high.
    assert (spectral_floor(samples) > 2.5 * there).all()
