"""Channels at the end of a sensor's range are told from those that turn back or come to rest, coarse or not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from excite.logs.columns import clipped_samples
from excite.logs.quantisation import channel_noise, coarse_step

ALWAYS = np.ones(2750, dtype=bool)
STEPS = (0.0, 2.0 * np.pi / 2**16, 2.0 * np.pi / 2**14, 2e-3)


def time(rate: float) -> np.ndarray:
    return np.arange(2750) / rate


def swinging(seed: int, rate: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    turns, phases = rng.uniform(0.15, 0.9, 4), rng.uniform(0.0, 6.28, 4)
    values = (np.sin(2.0 * np.pi * turns * time(rate)[:, None] + phases) / turns).sum(axis=1)
    return values / np.abs(values).max()


def resting(seed: int, rate: float) -> np.ndarray:
    """Minimum-jerk moves to and fro, with rests at both ends."""
    rng = np.random.default_rng(seed)
    parts, here, there = [], 0.0, 1.0
    while sum(map(len, parts)) < 2750:
        s = np.linspace(0.0, 1.0, int(rng.uniform(0.8, 1.5) * rate))
        parts += [np.full(int(rng.uniform(0.3, 1.0) * rate), here)]
        parts += [here + (there - here) * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5)]
        here, there = there, here
    return np.concatenate(parts)[:2750]


def counted(values: np.ndarray, rate: float, step: float, noise: float, seed: int) -> int:
    """What is said of values with noise, then rounded."""
    noisy = values + noise * np.random.default_rng(seed).standard_normal(len(values))
    read = step * np.round(noisy / step) if step else noisy
    size = channel_noise(time(rate), [read])[0]
    return clipped_samples(read, coarse_step(read, size), size, ALWAYS)


@settings(max_examples=80, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    rate=st.sampled_from([100.0, 200.0, 1000.0]),
    step=st.sampled_from(STEPS),
    noise=st.sampled_from([0.0, 1e-5, 1e-3]),
    at_rest=st.booleans(),
)
def test_what_turns_back_or_rests_is_not_clipped(
    seed: int, rate: float, step: float, noise: float, at_rest: bool
) -> None:
    values = resting(seed, rate) if at_rest else swinging(seed, rate)
    assert counted(values, rate, step, noise, seed) == 0


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("noise", [0.0, 1e-3, 1e-2])
def test_what_is_cut_off_is_clipped(step: float, noise: float) -> None:
    """Six motions, cut at heights that reach into several swings, by more than the noise before the range ends."""
    for seed in range(6):
        values = swinging(seed, 200.0) + noise * np.random.default_rng(seed).standard_normal(2750)
        for share in (0.03, 0.1, 0.2) if noise < 1e-2 else (0.1, 0.2):
            low, high = np.quantile(values, [0.5 * share, 1.0 - 0.5 * share])
            read = np.clip(values, low, high)
            read = step * np.round(read / step) if step else read
            at_ends = int(np.sum((read == read.max()) | (read == read.min())))
            size = channel_noise(time(200.0), [read])[0]
            count = clipped_samples(read, coarse_step(read, size), size, ALWAYS)
            # One of the two ends may be reached but once, at the edge of the record.
            assert 0.3 * at_ends < count <= at_ends, (seed, share)


def test_a_channel_on_one_side_of_its_range_is_counted_there_alone() -> None:
    values = np.minimum(swinging(7, 200.0), 0.6)
    assert counted(values, 200.0, 0.0, 0.0, 0) == np.sum(values == 0.6)


def test_standstill_of_the_robot_is_no_clipping() -> None:
    values = np.minimum(swinging(7, 200.0), 0.6)
    assert clipped_samples(values, 0.0, 0.0, values < 0.6) == 0
    assert clipped_samples(np.full(2750, 3.0), 0.0, 0.0, ALWAYS) == 0
