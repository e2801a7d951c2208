"""The likelihood's whitening: rows of a record become independent numbers of unit variance.

Filtered noise is strongly correlated in time, wrenches at a base share their force noise between channels,
and noise of accelerations grows with the square of frequency: a constant force is seen a hundred times more
sharply than the root mean square of the residual suggests. In the frequency domain all of that is one
covariance matrix a frequency (Whittle 1953).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal.windows import tukey

from excite.diagnosis.floating.record import FloatingRecord
from excite.diagnosis.floating.state import State
from excite.robot.robot import Array

BAND_HZ = 3.5
# Where predictions hold acceleration noise and hardly any motion.
_NOISE_BAND_HZ = (2.9, 4.1)


@dataclass(frozen=True, eq=False)
class Whitening:
    """Linear map from ``(n, 6, …)`` samples to ``(m, …)`` whitened numbers.

    Attributes:
        record: the record.
        factors: by trial, ``(n_bins, 6, 6)`` inverse Cholesky factor of the noise at each frequency.
        tapers: by trial, ``(n_samples,)``.
        rows: by trial, rows of the result.
    """

    record: FloatingRecord
    factors: tuple[Array, ...]
    tapers: tuple[Array, ...]
    rows: tuple[slice, ...]

    @property
    def n_rows(self) -> int:
        """Number of whitened numbers."""
        return self.rows[-1].stop

    def __call__(self, values: Array) -> Array:
        """Whiten ``(n, 6)`` or ``(n, 6, k)``."""
        flat = values.reshape(len(values), 6, -1)
        out = np.empty((self.n_rows, flat.shape[2]))
        for span, factor, taper, rows in zip(
            self.record.spans, self.factors, self.tapers, self.rows, strict=True
        ):
            spectrum = np.fft.rfft(flat[span] * taper[:, None, None], axis=0)[: len(factor)]
            white = factor @ spectrum
            n = white.shape[0] * 6
            out[rows.start : rows.start + n] = white.real.reshape(n, -1)
            # A constant has no imaginary part.
            out[rows.start + n : rows.stop] = white.imag[1:].reshape(n - 6, -1)
        return out.reshape(self.n_rows, *values.shape[2:])

    def validation_rows(self) -> Array:
        """``(m,)`` which whitened numbers are of validation trials."""
        mask = np.zeros(self.n_rows, dtype=bool)
        for rows, held_out in zip(self.rows, self.record.validation, strict=True):
            mask[rows] = held_out
        return mask


def make_whitening(record: FloatingRecord, state: State) -> Whitening:
    """Noise model from what cannot hold any effect: readings above the band, predictions at its upper edge.

    ``S(f) = A + B (f/f0)^4``: A, white noise of the sensors; B, noise of the kinematics, differentiated twice.

    Args:
        record: the record.
        state: the nominal state, whose predictions carry the kinematics' noise.
    """
    sensors = record.sensor_noise * record.rate_hz / record.full_rate_hz
    kinematics, centre = _kinematic_noise(record, state.predicted)
    factors, tapers, rows, start = [], [], [], 0
    for span in record.spans:
        taper, frequency = _taper_and_frequency(record, span)
        frequency = frequency[frequency <= BAND_HZ]
        noise = sensors + kinematics * (frequency[:, None, None] / centre) ** 4
        # Real and imaginary part share a bin's power, except at zero frequency.
        noise[1:] *= 0.5
        factors.append(np.linalg.inv(np.linalg.cholesky(noise)))
        tapers.append(taper)
        stop = start + 12 * len(frequency) - 6
        rows.append(slice(start, stop))
        start = stop
    return Whitening(record, tuple(factors), tuple(tapers), tuple(rows))


def _taper_and_frequency(record: FloatingRecord, span: slice) -> tuple[Array, Array]:
    n = span.stop - span.start
    taper = tukey(n, 0.1)
    return taper / np.sqrt((taper**2).sum()), np.fft.rfftfreq(n, 1.0 / record.rate_hz)


def _kinematic_noise(record: FloatingRecord, predicted: Array) -> tuple[Array, float]:
    """``(6, 6)`` noise of predictions at the centre of the noise band, and that frequency [Hz]."""
    low, high = _NOISE_BAND_HZ
    centre = float(np.sqrt(low * high))
    pieces = []
    for span in record.spans:
        taper, frequency = _taper_and_frequency(record, span)
        inside = (frequency >= low) & (frequency <= high)
        smooth = predicted[span] - predicted[span].mean(axis=0)
        spectrum = np.fft.rfft(smooth * taper[:, None], axis=0)[inside]
        pieces.append(spectrum * (centre / frequency[inside, None]) ** 2)
    spectrum = np.concatenate(pieces)
    return (spectrum.conj().T @ spectrum).real / len(spectrum), centre
