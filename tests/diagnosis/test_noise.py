"""What noise does to a gap, and how sure the share closed is, against simulation."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from excite.diagnosis.answer.gap import gap_of
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import (
    kinematic_noise,
    position_noise,
    spectral_floor,
    unrepeated_noise_power,
    white_floor,
)
from excite.diagnosis.equations.resampling import arm_samples
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.equations.standing_joints import held_power
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import noise_bandwidth
from excite.robot.loading import load_robot
from tests.made_log import made_log

RATE, SECONDS = 200.0, 8.0
NOISE = 5e-5
REACHES = (0.0, 0.0, 1.5)


@pytest.fixture(scope="module")
def clean() -> Log:
    """Exact rigid-body torques of three trials: upright, upright, and stretched out to the side."""
    robot = load_robot("iiwa14")
    data, n = robot.model.createData(), robot.n_joints
    time = np.arange(round(RATE * SECONDS) + 1) / RATE
    trials = []
    for k, reach in enumerate(REACHES):
        rate = 2.0 * np.pi * (0.2 + 0.03 * np.arange(n)) * (1.0 + 0.1 * k)
        wave = rate * time[:, None]
        q = 0.3 * np.sin(wave)
        q[:, 1] += reach
        v, a = 0.3 * rate * np.cos(wave), -0.3 * rate**2 * np.sin(wave)
        tau = np.array([pin.rnea(robot.model, data, *row) for row in zip(q, v, a, strict=True)])
        repeats = "trial_0" if k == 1 else None
        trials.append(
            Trial(name=f"trial_{k}", role="identification", time=time, q=q, tau=tau, repeats=repeats)
        )
    return made_log(trials, robot.joint_names, RATE, modelled=["rigid_body_fixed"])


def _baseline(log: Log) -> Baseline:
    robot = load_robot("iiwa14")
    samples = arm_samples(robot, log, log.trials)
    return fit_baseline(samples, log.header.modelled, np.full(robot.n_joints, 1e-3))


def test_noise_of_positions_is_seen_and_carried_to_the_torques_of_each_posture(clean: Log) -> None:
    rng = np.random.default_rng(0)
    noisy = replace(
        clean,
        trials=tuple(replace(t, q=t.q + NOISE * rng.standard_normal(t.q.shape)) for t in clean.trials),
    )
    baseline = _baseline(noisy)
    samples, joints = baseline.samples, range(7)
    sigma = position_noise(samples, joints, noisy.trials)
    np.testing.assert_allclose(sigma, NOISE, rtol=0.2)
    np.testing.assert_array_less(position_noise(_baseline(clean).samples, joints, clean.trials), 0.02 * NOISE)
    predicted = kinematic_noise(baseline, sigma, np.random.default_rng(1))
    # What is left of torques without noise is what the positions' noise made of them.
    left = baseline.plain_residual(baseline.fit.residual)
    for k in range(len(REACHES)):
        rows = samples.trial_of_row == k
        np.testing.assert_allclose(predicted[:, rows].std(axis=1), left[:, rows].std(axis=1), rtol=0.35)
    # The repeated trials are upright: they do not show what the first joint feels of an arm stretched out.
    more = unrepeated_noise_power(samples, predicted)
    shown = np.isin(samples.trial_of_row, (0, 1))
    assert more[0] > 0.3 * (predicted[0, shown] ** 2).mean()
    assert more[0] == pytest.approx((left[0] ** 2).mean() - (left[0, shown] ** 2).mean(), rel=0.5)


def _noise(samples: ArmSamples, rng: np.random.Generator, n: int) -> np.ndarray:
    """White noise that went through the filter of the rows, one channel a row, of unit variance."""
    signals = [rng.standard_normal((len(t.time), n)) for t in samples.trials]
    rows = samples.to_rows(signals).T
    return rows / rows.std()


def test_the_stated_interval_holds_the_share_closed_as_often_as_it_says(clean: Log) -> None:
    rng = np.random.default_rng(2)
    motions = clean.trials + tuple(replace(t, name=f"{t.name}_again") for t in clean.trials[1:])
    roles = ("identification", "identification", "validation", "validation", "validation")
    trials = tuple(replace(t, role=r) for t, r in zip(motions, roles, strict=True))
    samples = arm_samples(load_robot("iiwa14"), clean, trials)
    n, held = 7, []
    for _ in range(60):
        # Half of the noise's power is left of a gap of ten times its power, more in some motions than in others.
        level = np.sqrt(rng.uniform(0.5, 1.5, len(trials)))[samples.trial_of_row]
        rest = np.sqrt(0.5) * level * _noise(samples, rng, n)
        removed, noise = np.sqrt(9.5) * _noise(samples, rng, n), _noise(samples, rng, n)
        first, again = (_noise(samples, rng, n)[:, samples.trial_of_row == 0] for _ in range(2))
        floor = np.sqrt(0.5 * ((first - again) ** 2).mean(axis=1))
        gap = gap_of(samples, noise + rest + removed, noise + rest, floor, np.ones(n), rng)
        assert gap.interval is not None
        assert gap.interval[0] <= gap.share_closed <= gap.interval[1] <= 1.0
        held.append(gap.interval[0] <= 0.95 <= gap.interval[1])
    assert 0.8 <= np.mean(held) <= 0.99


def test_two_trials_state_an_interval_by_their_parts_and_no_gap_states_none(clean: Log) -> None:
    trials = tuple(
        replace(t, role=r, repeats=None)
        for t, r in zip(clean.trials[1:], ("identification", "validation"), strict=True)
    )
    samples = arm_samples(load_robot("iiwa14"), clean, trials)
    rng, n = np.random.default_rng(4), 7
    floor, scale = np.full(n, 0.1), np.ones(n)
    noise = 0.1 * _noise(samples, rng, n)
    steady, burst = np.ones(samples.trial_of_row.shape), (np.arange(len(samples.trial_of_row)) % 300) < 40
    widths = []
    for when in (steady, np.sqrt(len(burst) / burst.sum()) * burst):
        rest = 0.3 * when * _noise(samples, rng, n)
        gap = gap_of(samples, noise + rest + _noise(samples, rng, n), noise + rest, floor, scale, rng)
        assert gap.interval is not None
        assert gap.interval[0] < gap.share_closed < gap.interval[1] <= 1.0
        widths.append(gap.interval[1] - gap.interval[0])
    # What is left in bursts is less surely known.
    assert widths[1] > 1.5 * widths[0]
    assert gap_of(samples, 0.5 * noise, 0.4 * noise, floor, scale, rng).interval is None


def test_jumps_of_friction_do_not_pass_for_noise(clean: Log) -> None:
    """Sudden changes reach far beyond the band of the motion; white noise is as strong further up."""
    rng, level = np.random.default_rng(3), 0.02
    trials = tuple(
        replace(
            t, tau=t.tau + 0.2 * np.sign(np.gradient(t.q, axis=0)) + level * rng.standard_normal(t.q.shape)
        )
        for t in clean.trials
    )
    samples = arm_samples(load_robot("iiwa14"), clean, trials)
    true = level * np.sqrt(noise_bandwidth(RATE, samples.bands.rows_hz))
    np.testing.assert_allclose(white_floor(samples), true, rtol=0.4)
    assert spectral_floor(samples)[-1] > 2.0 * true


def test_without_repeats_nothing_is_known_of_what_they_do_not_show() -> None:
    samples = SimpleNamespace(repeat_pairs=(), trial_of_row=np.zeros(10, dtype=np.int64))
    np.testing.assert_array_equal(unrepeated_noise_power(samples, np.ones((3, 10))), np.zeros(3))


def test_what_holds_a_standing_joint_is_a_floor():
    """A joint that rests for half of the time leaves what its friction takes up then, and no noise beyond it."""
    rows, v = np.arange(400), np.where(np.arange(400) < 200, 0.0, 0.5)[:, None]
    samples = SimpleNamespace(
        standstill=np.array([0.01]), motor_signal=lambda name: v, to_rows=lambda values: values
    )
    rng = np.random.default_rng(2)
    residual = (0.1 * rng.standard_normal(400) + np.where(rows < 200, 0.5, 0.0))[None]
    every = np.ones(400, dtype=np.bool_)
    held = held_power(samples, residual, np.array([0.1]), every)
    assert held[0] == pytest.approx(0.5 * 0.25, rel=0.1)
    assert held_power(samples, residual, np.array([0.1]), rows >= 200)[0] == 0.0
    assert held_power(samples, 0.1 * np.ones((1, 400)), np.array([0.1]), every)[0] == pytest.approx(0.0)


def test_what_moving_joints_leave_alike_is_no_hold():
    """A constant that the model lacks is a gap wherever the joint is; what holds it at rest stands above that."""
    rows, v = np.arange(400), np.where(np.arange(400) < 200, 0.0, 0.5)[:, None]
    samples = SimpleNamespace(
        standstill=np.array([0.01]), motor_signal=lambda name: v, to_rows=lambda values: values
    )
    every, floor = np.ones(400, dtype=np.bool_), np.array([0.1])
    assert held_power(samples, np.full((1, 400), 2.0), floor, every)[0] == 0.0
    residual = np.where(rows < 200, np.sqrt(4.25), 2.0)[None]
    assert held_power(samples, residual, floor, every)[0] == pytest.approx(0.5 * 0.25)
