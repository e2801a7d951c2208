"""Power spectra against scipy's, and against the power that is in the signal."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from excite.logs.signals.spectrum import welch_spectrum


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
