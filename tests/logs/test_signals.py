"""Signal processing against closed forms."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy import signal

from excite.errors import LogError
from excite.logs.signals.base_pose import base_motion
from excite.logs.signals.butterworth import (
    central_differences,
    lowpass,
    noise_bandwidth,
    settling_samples,
)
from excite.logs.signals.resample import (
    is_uniform,
    moving_span,
    near_samples,
    resample_noisy,
    resample_smooth,
    uniform_grid,
)
from excite.logs.signals.spectrum import welch_spectrum
from tests.reproduction.periods import average_periods, periodic_derivatives

RATE = 200.0
TIME = np.arange(2000) / RATE


@pytest.mark.parametrize("order", [1, 2, 4, 6])
@pytest.mark.parametrize("frequency", [2.0, 10.0, 25.0])
def test_filter_has_no_phase_and_the_stated_amplitude(order: int, frequency: float) -> None:
    inner = slice(600, -600)
    filtered = lowpass(np.sin(2 * np.pi * frequency * TIME), RATE, 10.0, order)[inner]
    # The bilinear transform's frequency axis.
    ratio = np.tan(np.pi * frequency / RATE) / np.tan(np.pi * 10.0 / RATE)
    expected = 1.0 / (1.0 + ratio ** (2 * order))
    np.testing.assert_allclose(filtered, expected * np.sin(2 * np.pi * frequency * TIME)[inner], atol=2e-3)


def test_filter_above_half_the_rate_changes_nothing_and_short_signals_are_refused() -> None:
    values = np.random.default_rng(0).normal(size=(50, 3))
    np.testing.assert_array_equal(lowpass(values, RATE, 150.0), values)
    assert settling_samples(RATE, 150.0) == 0
    with pytest.raises(LogError, match="too few"):
        lowpass(values, RATE, 5.0)


@pytest.mark.parametrize("cutoff", [5.0, 20.0, 60.0])
def test_noise_bandwidth_is_what_is_left_of_white_noise(cutoff: float) -> None:
    noise = np.random.default_rng(1).normal(size=(4000, 40))
    left = lowpass(noise, RATE, cutoff, 4)[300:-300].var()
    assert left == pytest.approx(noise_bandwidth(RATE, cutoff, 4), rel=0.03)


def test_central_differences_are_of_sixth_order() -> None:
    errors = []
    for rate in (50.0, 100.0):
        time = np.arange(400) / rate
        d = central_differences(np.sin(7.0 * time), rate)
        inner = slice(3, -3)
        errors.append(
            [
                np.abs(d.first - 7.0 * np.cos(7.0 * time))[inner].max(),
                np.abs(d.second + 49.0 * np.sin(7.0 * time))[inner].max(),
            ]
        )
        bound = (7.0 / rate) ** 6
        assert errors[-1][0] == pytest.approx(7.0 * bound / 140.0, rel=0.1)
        assert errors[-1][1] == pytest.approx(49.0 * bound / 560.0, rel=0.1)
    assert np.log2(np.array(errors[0]) / errors[1]) == pytest.approx([6.0, 6.0], abs=0.1)


def test_differentiation_in_the_frequency_domain_is_exact_on_a_fourier_motion() -> None:
    """Xu et al. 2020, section II.C, on a motion of five harmonics as in its eq. 8."""
    rng = np.random.default_rng(2)
    omega = 2 * np.pi * 0.05
    time = np.arange(4000) / 200.0
    harmonic = np.arange(1, 6) * omega
    a, b = rng.normal(size=(2, 5))
    phase = time[:, None] * harmonic
    position = (a * np.sin(phase) / harmonic - b * np.cos(phase) / harmonic).sum(axis=1)
    noise = 1e-3 * np.sin(2 * np.pi * 40.0 * time)
    d = periodic_derivatives(position + noise, 200.0, 0.25)
    np.testing.assert_allclose(d.value, position, atol=1e-10)
    np.testing.assert_allclose(d.first, (a * np.cos(phase) + b * np.sin(phase)).sum(axis=1), atol=1e-10)
    second = (harmonic * (b * np.cos(phase) - a * np.sin(phase))).sum(axis=1)
    np.testing.assert_allclose(d.second, second, atol=1e-10)


def test_averaging_leaves_noise_over_the_root_of_the_periods() -> None:
    """Xu et al. 2020, eq. 11."""
    rng = np.random.default_rng(3)
    period = np.sin(2 * np.pi * np.arange(500) / 500)
    values = np.tile(period, 20) + 0.1 * rng.normal(size=10_000)
    average = average_periods(np.concatenate([np.full(500, 9.0), values, values[:77]]), 500, skip=1)
    assert average.n_periods == 20
    assert average.std == pytest.approx(0.1, rel=0.05)
    assert (average.mean - period).std() == pytest.approx(0.1 / np.sqrt(20), rel=0.1)
    with pytest.raises(LogError, match="no period"):
        average_periods(values[:400], 500)


def test_resampling_jittered_stamps() -> None:
    rng = np.random.default_rng(4)
    time = np.cumsum(rng.uniform(0.006, 0.014, 800))
    time = np.delete(time, slice(300, 320))
    grid = uniform_grid(time, 100.0)
    assert is_uniform(grid, 100.0)
    assert not is_uniform(time, 100.0)
    near = near_samples(time, grid, 0.05)
    gap = (grid > time[299]) & (grid < time[300])
    np.testing.assert_array_equal(near, ~gap)
    error = np.abs(resample_smooth(time, np.sin(6.0 * time), grid) - np.sin(6.0 * grid))
    assert np.median(error[near]) < 1e-7
    assert error[near].max() < 2e-4
    crowded = np.sort(np.concatenate([time, time[400:500] + 1e-4]))
    noise = rng.normal(size=len(crowded))
    assert np.abs(resample_noisy(crowded, noise, grid)).max() <= np.abs(noise).max()
    assert np.abs(resample_smooth(crowded, noise, grid)).max() > 10.0 * np.abs(noise).max()
    for resample in (resample_noisy, resample_smooth):
        with pytest.raises(LogError, match="leaves the samples"):
            resample(time, time, grid - 1.0)


def test_standstill_is_found() -> None:
    velocity = np.zeros((100, 2))
    velocity[20:70, 1] = -0.3
    assert moving_span(velocity, 0.1) == slice(20, 70)
    with pytest.raises(LogError, match="no joint"):
        moving_span(velocity, 1.0)


def test_base_motion_is_what_pinocchio_integrates() -> None:
    """A pose whose twist is known in closed form, in pinocchio's free-flyer convention."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    rate = 400.0
    time = np.arange(1200) / rate

    def pose(t: float) -> pin.SE3:
        rotation = pin.exp3(np.array([0.8 * np.sin(t), 0.5 * np.cos(1.3 * t), 2.5 * t]))
        return pin.SE3(rotation, np.array([np.sin(2 * t), 0.3 * t, np.cos(1.7 * t)]))

    def twist(t: float, h: float = 1e-4) -> np.ndarray:
        return pin.log6(pose(t - h).actInv(pose(t + h))).vector / (2 * h)

    raw = np.array([pin.SE3ToXYZQUAT(pose(t)) for t in time])
    raw[::2, 3:] *= -1.0  # the same rotations
    motion = base_motion(raw, rate, 100.0)
    for i in range(150, 1050, 90):
        t = time[i]
        np.testing.assert_allclose(motion.twist[i], twist(t), atol=1e-5)
        expected = (twist(t + 1e-3) - twist(t - 1e-3)) / 2e-3
        np.testing.assert_allclose(motion.acceleration[i], expected, atol=2e-4)
    # Pinocchio's own integration of the twist follows the pose.
    q = motion.pose[300].copy()
    for i in range(300, 500):
        q = pin.integrate(model, q, 0.5 * (motion.twist[i] + motion.twist[i + 1]) / rate)
    apart = pin.XYZQUATToSE3(q).actInv(pin.XYZQUATToSE3(motion.pose[500]))
    assert np.linalg.norm(pin.log6(apart).vector) < 1e-4


# Power spectra.


@pytest.mark.parametrize(("n", "length"), [(2749, 256), (300, 150), (255, 127), (100, 100)])
@pytest.mark.parametrize("shape", [(), (3,)])
@pytest.mark.parametrize("median", [True, False])
@pytest.mark.parametrize("centred", [True, False])
def test_densities_are_scipys(
    n: int, length: int, shape: tuple[int, ...], median: bool, centred: bool
) -> None:
    values = np.random.default_rng(0).normal(size=(n, *shape)).cumsum(axis=0)
    average, detrend = ("median" if median else "mean"), ("constant" if centred else False)
    expected = signal.welch(values, 200.0, nperseg=length, axis=0, average=average, detrend=detrend)
    found = welch_spectrum(values, 200.0, length, median=median, centred=centred)
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-13)
    np.testing.assert_allclose(found[1], expected[1], rtol=1e-9)


def test_density_of_white_noise_is_its_power_over_half_the_rate() -> None:
    noise = np.random.default_rng(1).normal(size=60000)
    frequency, density = welch_spectrum(noise, 50.0, 200, median=True)
    assert frequency[-1] == 25.0
    assert np.median(density[1:-1]) == pytest.approx(1.0 / 25.0, rel=0.03)
