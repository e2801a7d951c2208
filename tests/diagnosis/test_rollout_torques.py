"""Torques that drive roll-outs, and what noise makes of them, against signals that are known without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.diagnosis.equations.arm_trial import ArmTrial, Bands
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.simulator.rollout_compare import position_noise, replicated
from excite.diagnosis.simulator.rollout_windows import LoggedTorque, Plan, driving_torques, torque_plan
from excite.logs.signals.butterworth import central_differences, lowpass
from excite.robot.loading import load_robot

RATE, KP, KD, SIGMA_Q, SIGMA_TAU = 200.0, 800.0, 40.0, 2e-5, 0.4
ROBOT = load_robot("ur10")
INDEX = tuple(range(6))


def trial(number: int, rng: np.random.Generator, unexplained: float) -> tuple[ArmTrial, np.ndarray]:
    """A joint-space motion under a servo, as logged, and its torques without noise."""
    time = np.arange(2000) / RATE
    rates = rng.uniform(0.5, 3.0, (4, 6))
    command = 0.4 * np.sin(time[:, None, None] * rates + rng.uniform(0.0, 6.0, (4, 6))).sum(axis=1)
    error = 4e-3 * np.sin(time[:, None, None] * 1.7 * rates + rng.uniform(0.0, 6.0, (4, 6))).sum(axis=1)
    truth = (
        KP * error
        + KD * np.gradient(error, 1.0 / RATE, axis=0)
        + unexplained * np.sign(np.sin(5.0 * time))[:, None]
    )
    q = command - error + SIGMA_Q * rng.standard_normal(command.shape)
    d = central_differences(lowpass(q, RATE, 30.0), RATE)
    tau = truth + SIGMA_TAU * rng.standard_normal(truth.shape)
    rows = np.arange(60, 1940, 4)
    made = ArmTrial(
        f"trial_{number}", True, None, time, time, d.value, d.first, d.second, tau, rows, q_cmd=command
    )
    return made, truth


def record(unexplained: float = 0.0) -> tuple[ArmSamples, dict[str, np.ndarray]]:
    rng = np.random.default_rng(7)
    made = [trial(k, rng, unexplained) for k in range(4)]
    samples = ArmSamples(
        ROBOT,
        ROBOT.joint_names,
        INDEX,
        tuple(t for t, _ in made),
        RATE,
        Bands(),
        np.eye(6),
        np.full(6, 0.01),
    )
    return samples, {t.name: truth for t, truth in made}


def slow_error(samples: ArmSamples, torque: dict, truth: dict) -> float:
    """RMS of what a roll-out of half a second integrates: errors slower than 2 Hz, ends left out."""
    return float(
        np.sqrt(
            np.mean(
                [lowpass(torque[t.name] - truth[t.name], RATE, 2.0)[100:-100] ** 2 for t in samples.trials]
            )
        )
    )


def test_what_commands_tell_takes_the_noise_out_of_the_torques():
    samples, truth = record()
    driving = driving_torques(samples)
    logged = slow_error(samples, {t.name: t.tau for t in samples.trials}, truth)
    assert driving.smoothed
    assert slow_error(samples, driving.torque, truth) < 0.45 * logged
    assert driving.sigma == pytest.approx(np.full(6, SIGMA_TAU), rel=0.25)
    assert driving.gains[0] == pytest.approx(np.full(6, KP), rel=0.02)


def test_torque_that_no_law_of_the_commands_gives_stays():
    """A square wave that the servo's law does not have: it comes through, with no more error than the noise was."""
    samples, truth = record(unexplained=1.0)
    driving = driving_torques(samples)
    logged = slow_error(samples, {t.name: t.tau for t in samples.trials}, truth)
    assert slow_error(samples, driving.torque, truth) < logged
    wave = np.sign(np.sin(5.0 * samples.trials[0].time))[:, None]
    explained = replace(samples, trials=record()[0].trials)
    apart = driving.torque["trial_0"] - driving_torques(explained).torque["trial_0"]
    share = (apart * wave)[100:-100].mean(axis=0)
    assert share == pytest.approx(np.ones(6), abs=0.15)


def test_without_commands_torques_are_the_logs():
    samples, _ = record()
    silent = replace(samples, trials=tuple(replace(t, q_cmd=None) for t in samples.trials))
    plan = torque_plan(silent)
    assert plan.driven_by == "logged torque"
    for t in silent.trials:
        drive = plan.drives[t.name]
        assert isinstance(drive, LoggedTorque) and np.array_equal(drive.tau, t.tau)
    assert torque_plan(samples).driven_by != "logged torque"


def test_replicas_have_the_noise_of_the_record():
    samples, _ = record()
    assert position_noise(samples) == pytest.approx(np.full(6, SIGMA_Q), rel=0.3)
    silent = replace(samples, trials=tuple(replace(t, q_cmd=None) for t in samples.trials))
    plan = torque_plan(silent)
    again, noisy = replicated(silent, plan, np.random.default_rng(1))
    moved = np.concatenate([a.q - b.q for a, b in zip(again.trials, silent.trials, strict=True)])
    assert moved.std() == pytest.approx(SIGMA_Q, rel=0.3)
    pushed = [noisy.drives[t.name].tau - plan.drives[t.name].tau for t in silent.trials]
    assert np.concatenate(pushed).std() == pytest.approx(SIGMA_TAU, rel=0.15)
    # What commands tell is no more certain than the positions that the servo saw: slow noise is left, but less.
    smoothed = torque_plan(samples)
    left = [
        replicated(samples, smoothed, np.random.default_rng(1))[1].drives[t.name].tau for t in samples.trials
    ]
    slow = np.concatenate(
        [
            lowpass(x - smoothed.drives[t.name].tau, RATE, 2.0)
            for x, t in zip(left, samples.trials, strict=True)
        ]
    )
    full = np.concatenate([lowpass(x, RATE, 2.0) for x in pushed])
    assert 0.0 < slow.std() < 0.5 * full.std()


def test_a_plan_of_another_drive_stays_as_it_is():
    samples, _ = record()
    drives = {t.name: LoggedTorque(t.time, t.tau) for t in samples.trials}
    plan = Plan(0.5, drives, "q_cmd")
    assert replicated(samples, plan, np.random.default_rng(0))[1].drives == drives
