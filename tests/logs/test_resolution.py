"""Quantised channels are found over a range of steps and noise; smooth ones and fine digits are left alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from excite.logs.quantisation import channel_noise, coarse_step, rounded_step

RATE = 200.0
TIME = np.arange(2000) / RATE


def motion(seed: int, size: float) -> np.ndarray:
    """A joint that swings, in the largest amplitude given."""
    rng = np.random.default_rng(seed)
    turns, phases = rng.uniform(0.1, 0.9, 4), rng.uniform(0.0, 6.28, 4)
    values = (np.sin(2.0 * np.pi * turns * TIME[:, None] + phases) / turns).sum(axis=1)
    return size * values / np.abs(values).max()


def found(values: np.ndarray, time: np.ndarray = TIME) -> float:
    return coarse_step(values, channel_noise(time, [values])[0])


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    step=st.floats(1e-5, 3e-2),
    noise=st.floats(0.0, 2.0),
    offset=st.floats(-2.0, 2.0),
)
def test_a_quantised_channel_is_found_with_its_step(
    seed: int, step: float, noise: float, offset: float
) -> None:
    """Noise in steps; the grid need not hold zero."""
    values = motion(seed, 1.0) + noise * step * np.random.default_rng(seed).standard_normal(len(TIME))
    assert found(step * np.round(values / step) + offset) == pytest.approx(step, rel=1e-3)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(1e-4, 100.0), noise=st.sampled_from([0.0, 1e-5, 1e-2]))
def test_a_smooth_channel_is_not_quantised(seed: int, size: float, noise: float) -> None:
    values = motion(seed, size) + noise * np.random.default_rng(seed).standard_normal(len(TIME))
    assert found(values) == 0.0
    assert found(values.astype(np.float32).astype(float)) == 0.0


@pytest.mark.parametrize("digits", [6, 5, 4])
def test_digits_finer_than_the_noise_are_no_fault(digits: int) -> None:
    values = motion(1, 1.0) + 1e-3 * np.random.default_rng(1).standard_normal(len(TIME))
    assert found(np.round(values, digits)) == 0.0


def test_a_step_shows_although_the_sampling_jitters() -> None:
    """Rows taken early or late by 15 % of a step look noisy over an even clock, not over their stamps."""
    rng = np.random.default_rng(2)
    stamps = TIME + rng.normal(0.0, 0.15 / RATE, len(TIME))
    step = 2.0 * np.pi / 2**16
    values = step * np.round(np.interp(stamps, TIME, motion(2, 1.5)) / step)
    assert found(values, stamps) == pytest.approx(step, rel=1e-6)


def test_a_limit_off_the_grid_hides_no_step() -> None:
    values = np.clip(0.01 * np.round(motion(3, 1.0) / 0.01), -0.8537, 0.8537)
    assert found(values) == pytest.approx(0.01)


def test_few_rows_or_a_switch_are_no_quantised_channel() -> None:
    assert found(np.round(motion(4, 1.0)[:150], 1), TIME[:150]) == 0.0
    assert found((motion(4, 1.0) > 0.0).astype(float)) == 0.0


@settings(max_examples=80, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    bits=st.integers(12, 18),
    digits=st.integers(4, 7),
    noise=st.sampled_from([0.0, 0.3, 1.0]),
    offset=st.floats(-2.0, 2.0),
)
@example(seed=6, bits=17, digits=6, noise=0.3, offset=1.05859375)
def test_the_step_of_an_encoder_is_found_under_the_digits_of_a_file(
    seed: int, bits: int, digits: int, noise: float, offset: float
) -> None:
    """Differences of 1.9e-4 and 2.0e-4 in a file with five decimals are steps of 1.917e-4."""
    step, digit = 2.0 * np.pi / 2**bits, 10.0**-digits
    assume(step > 2.2 * digit)
    rng = np.random.default_rng(seed)
    counts = np.round(motion(seed, 1.0) / step + noise * rng.standard_normal(len(TIME)))
    values = np.round(step * counts + offset, digits)
    assert found(values) == pytest.approx(step, rel=1e-3)
    assert found(np.radians(values)) == pytest.approx(np.radians(step), rel=1e-3)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), digits=st.integers(2, 5), size=st.floats(0.01, 30.0))
def test_digits_alone_are_their_own_step(seed: int, digits: int, size: float) -> None:
    """No encoder is seen in a smooth channel that a file rounds, however few of its numbers occur."""
    levels = np.unique(np.round(motion(seed, size)[:400], digits))
    assume(len(levels) > 30)
    assert rounded_step(levels, 10.0**-digits) == 10.0**-digits
