"""The band that the diagnosis looks at."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.equations.record import FloatingRecord
from excite.diagnosis.floating.equations.spectrum import BAND_HZ


def in_band(record: FloatingRecord, values: Array, below_hz: float = BAND_HZ) -> Array:
    """``(n, k)`` without what is above the band that the diagnosis looks at, or above ``below_hz``; ends faded out.

    A sharp edge in frequency, so that the noise model, which is for the band alone, says what noise is left.
    """
    out = []
    for span in record.spans:
        n = span.stop - span.start
        # scipy.signal takes 0.4 s to load, and an arm's diagnosis, which loads this module too, needs none of it.
        from scipy.signal.windows import tukey

        taper = tukey(n, 0.1)
        spectrum = np.fft.rfft(values[span] * (taper / np.sqrt((taper**2).mean()))[:, None], axis=0)
        spectrum[np.fft.rfftfreq(n, 1.0 / record.rate_hz) > below_hz] = 0.0
        out.append(np.fft.irfft(spectrum, n, axis=0))
    return np.concatenate(out)
