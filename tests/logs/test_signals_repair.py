"""Clocks, lags, coupled drives, decimation: against what was put into the signals."""

from __future__ import annotations

import numpy as np
import pytest

from excite.errors import InputError, UnknownNameError
from excite.logs.signals.butterworth import decimation_step, kept_samples, lowpass
from excite.logs.signals.coupling import coupling_matrix, joint_positions, joint_torques
from excite.logs.signals.resample import cubic_misfit, long_standstill

RATE = 200.0
TIME = np.arange(2000) / RATE


def motion(time: np.ndarray) -> np.ndarray:
    """Two joints, slow and fast."""
    return np.column_stack([np.sin(1.9 * time), 0.6 * np.cos(5.3 * time + 0.4)])


def test_misfit_of_white_noise_is_its_deviation_and_cubics_have_none() -> None:
    stamps = np.cumsum(np.random.default_rng(3).uniform(0.5, 1.5, 4000))
    noise = np.random.default_rng(4).normal(size=(4000, 1))
    assert cubic_misfit(stamps, noise).std() == pytest.approx(1.0, rel=0.05)
    assert np.abs(cubic_misfit(stamps / 4000, (stamps / 4000)[:, None] ** 3)).max() < 1e-9


def test_a_coupled_wrist_keeps_power() -> None:
    """Stäubli TX40: motor 6 turns by the sum of joints 5 and 6; gears 45 and 32."""
    joints = [f"joint_{i}" for i in range(1, 7)]
    matrix = coupling_matrix(joints, {"joint_6": {"joint_5": 1.0}})
    reductions = np.diag([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
    reductions[5, 4] = 32.0
    np.testing.assert_array_equal(np.diag(np.diag(reductions)) @ matrix, reductions)
    rng = np.random.default_rng(7)
    velocity, motor_torque = rng.normal(size=(2, 50, 6))
    motor_velocity = velocity @ matrix.T
    torque = joint_torques(motor_torque, matrix)
    np.testing.assert_allclose((torque * velocity).sum(1), (motor_torque * motor_velocity).sum(1))
    np.testing.assert_allclose(torque[:, 4], motor_torque[:, 4] + motor_torque[:, 5])
    np.testing.assert_allclose(joint_positions(velocity @ matrix.T, matrix), velocity, atol=1e-12)
    with pytest.raises(UnknownNameError, match="joint_9"):
        coupling_matrix(joints, {"joint_9": {"joint_5": 1.0}})
    with pytest.raises(InputError, match="no inverse"):
        coupling_matrix(joints, {"joint_6": {"joint_5": 1.0}, "joint_5": {"joint_6": 1.0}})


def test_decimation_keeps_what_is_slow_and_lets_nothing_alias() -> None:
    slow, fast = np.sin(2 * np.pi * 0.5 * TIME), np.sin(2 * np.pi * 63.0 * TIME)
    step = 8
    assert decimation_step(RATE, RATE / step) == step
    smooth = lowpass(slow + fast, RATE, 0.25 * RATE / step)
    kept = smooth[kept_samples(len(smooth), step)]
    inner = slice(20, -20)
    np.testing.assert_allclose(kept[inner], slow[step // 2 :: step][: len(kept)][inner], atol=5e-3)
    assert decimation_step(RATE, 150.0) == 1


def test_long_standstill_spares_changes_of_direction() -> None:
    velocity = np.sin(2.0 * TIME)[:, None]
    velocity[800:1000] = 0.0
    standing = long_standstill(velocity, 0.02, 50)
    assert standing[800:1000].all() and standing.sum() < 210
