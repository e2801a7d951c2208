"""Filters of second-order sections against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfilt, sosfilt_zi, sosfiltfilt, sosfreqz

from excite.logs.signals.butterworth import both_ways, butterworth_sections, lowpass, settling_samples


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5, 6])
@pytest.mark.parametrize(("rate", "cutoff"), [(200.0, 10.0), (1000.0, 3.0), (100.0, 45.0)])
def test_a_design_has_scipys_response_and_its_steady_state(order: int, rate: float, cutoff: float) -> None:
    sections, states = butterworth_sections(order, rate, cutoff)
    expected = sosfreqz(butter(order, cutoff, fs=rate, output="sos"))[1]
    np.testing.assert_allclose(sosfreqz(sections)[1], expected, rtol=1e-9, atol=1e-12)
    constant = sosfilt(sections, np.ones(50), zi=states)[0]
    np.testing.assert_allclose(constant, 1.0, rtol=1e-9)


@pytest.mark.parametrize("order", [1, 3, 4])
@pytest.mark.parametrize("shape", [(400,), (400, 1), (401, 7), (400, 70), (300, 2, 3)])
def test_the_low_pass_is_scipys_with_ends_reflected(order: int, shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(1).normal(size=shape).cumsum(axis=0)
    filter_ = butter(order, 10.0, fs=200.0, output="sos")
    expected = sosfiltfilt(filter_, values, axis=0, padlen=settling_samples(200.0, 10.0))
    np.testing.assert_allclose(lowpass(values, 200.0, 10.0, order), expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("width", [0, 1, 7, 65, 130])
def test_trials_beside_each_other_are_as_if_alone_and_held(width: int) -> None:
    lengths, rng = [300, 250, 290], np.random.default_rng(2)
    trials = [rng.normal(size=(n, width)).cumsum(axis=0) for n in lengths]
    rows = [np.arange(20 + k, n - 20, 3) for k, n in enumerate(lengths)]
    sections, states = butterworth_sections(4, 200.0, 10.0)
    found = both_ways(
        np.concatenate(trials),
        np.cumsum(lengths),
        np.concatenate(rows),
        np.cumsum([len(r) for r in rows]),
        sections,
        states,
    )
    expected = []
    for trial, kept in zip(trials, rows, strict=True):
        held = np.concatenate([trial, np.repeat(trial[-1:], max(lengths) - len(trial), axis=0)])
        for _ in range(2):
            start = sosfilt_zi(sections)[:, :, None] * held[0]
            held = sosfilt(sections, held, axis=0, zi=start)[0][::-1]
        expected.append(held[kept])
    np.testing.assert_allclose(found, np.concatenate(expected), rtol=1e-11, atol=1e-11)
