"""Rows that a clipped torque spoils through its filter are left out, and no more of them."""

from __future__ import annotations

import numpy as np
import pytest

from excite.logs.signals.butterworth import lowpass
from excite.rows.saturation import reached_samples


@pytest.mark.parametrize(("rate_hz", "cutoff_hz"), [(100.0, 5.0), (500.0, 10.0), (1000.0, 3.0)])
def test_next_to_nothing_of_a_clipped_stretch_is_left_in_the_rows_that_stay(
    rate_hz: float, cutoff_hz: float
) -> None:
    """A fiftieth of what was cut off, at a period of the cut-off from it."""
    period = int(rate_hz / cutoff_hz)
    beyond = np.zeros((40 * period, 1), dtype=bool)
    beyond[20 * period : 21 * period] = True
    reached = reached_samples(beyond, rate_hz, cutoff_hz)
    assert np.abs(lowpass(beyond.astype(float), rate_hz, cutoff_hz, 4)[~reached]).max() < 0.02
    assert reached.sum() - beyond.sum() <= 2 * (period + 1)
