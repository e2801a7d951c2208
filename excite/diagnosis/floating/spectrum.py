"""The likelihood's whitening: rows of a record become independent numbers of unit variance.

Filtered noise is strongly correlated in time, wrenches at a base share their force noise between channels,
and noise of accelerations grows with the square of frequency: a constant force is seen a hundred times more
sharply than the root mean square of the residual suggests. In the frequency domain all of that is one
covariance matrix a frequency (Whittle 1953)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.record import FloatingRecord
from excite.diagnosis.floating.state import State

BAND_HZ = 3.5
# Where predictions hold acceleration noise and hardly any motion.
_NOISE_BAND_HZ = (2.9, 4.1)


@dataclass(frozen=True, eq=False)
class Whitening:
    """Linear map from ``(n, c, …)`` samples of c channels to ``(m, …)`` whitened numbers.

    Attributes:
        record: the record.
        factors: by trial, ``(n_bins, c, c)`` inverse Cholesky factor of the noise at each frequency.
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
        """Whiten ``(n, c)`` or ``(n, c, k)``."""
        c = self.factors[0].shape[1]
        flat = values.reshape(len(values), c, -1)
        out = np.empty((self.n_rows, flat.shape[2]))
        for span, factor, transform, rows in zip(
            self.record.spans, self.factors, self._fourier_rows, self.rows, strict=True
        ):
            samples = flat[span].reshape(transform.shape[1], -1)
            parts = (transform @ samples).reshape(2, len(factor), c, -1)
            n = len(factor) * c
            out[rows.start : rows.start + n] = (factor @ parts[0]).reshape(n, -1)
            # A constant has no imaginary part.
            out[rows.start + n : rows.stop] = (factor[1:] @ parts[1, 1:]).reshape(n - c, -1)
        return out.reshape(self.n_rows, *values.shape[2:])

    @cached_property
    def _fourier_rows(self) -> tuple[Array, ...]:
        """By trial, ``(2·n_bins, n_samples)`` real and imaginary rows of the tapered Fourier transform.

        Of its bins only those in the band are wanted, which a product gives sooner than a fast transform of all.
        """
        transforms = []
        for taper, factor in zip(self.tapers, self.factors, strict=True):
            n = len(taper)
            angle = 2.0 * np.pi / n * (np.outer(np.arange(len(factor)), np.arange(n)) % n)
            transforms.append(np.vstack([np.cos(angle), -np.sin(angle)]) * taper)
        return tuple(transforms)

    def validation_rows(self) -> Array:
        """``(m,)`` which whitened numbers are of validation trials."""
        mask = np.zeros(self.n_rows, dtype=bool)
        for rows, held_out in zip(self.rows, self.record.validation, strict=True):
            mask[rows] = held_out
        return mask


@dataclass(frozen=True, eq=False)
class Repeatability:
    """What repeated trials say of the noise model.

    Attributes:
        level: power of the difference of repeated trials over what the noise model expects, in the lower
            half of the band; None without repeated trials.
        repeatable: whether that is noise: a push or a contact at other moments is not.
    """

    level: float | None
    repeatable: bool


# A difference of repeated trials that is this many times the expected noise is something that happened.
NOT_NOISE = 8.0
_SCALE_RANGE = (0.8, 2.5)


def scaled_to_repeats(whitening: Whitening, residual: Array) -> tuple[Whitening, Repeatability]:
    """The whitening with its noise scaled, by a straight line in frequency, to what repeated trials show.

    Args:
        whitening: from :func:`make_whitening`.
        residual: ``(n, 6)`` nominal residual.
    """
    level = repeat_levels(whitening, whitening(residual))
    if level is None:
        return whitening, Repeatability(None, True)
    shortest = len(level)
    low = float(level[: shortest // 2].mean())
    if low > NOT_NOISE:
        return whitening, Repeatability(low, False)
    line = np.polynomial.Polynomial.fit(np.arange(shortest), level, 1)
    factors = tuple(
        factor
        / np.sqrt(np.clip(line(np.arange(len(factor)) * shortest / len(factor)), *_SCALE_RANGE))[
            :, None, None
        ]
        for factor in whitening.factors
    )
    return replace(whitening, factors=factors), Repeatability(low, True)


def repeat_levels(whitening: Whitening, white: Array) -> Array | None:
    """Power of the difference of repeated trials over the expected noise, by frequency; None without repeats.

    Args:
        white: ``(n_rows,)`` whitened residual.
    """
    levels = []
    for first, second in whitening.record.repeats:
        n_bins = min(len(whitening.factors[first]), len(whitening.factors[second]))
        c = whitening.factors[first].shape[1]
        one, two = (_bin_power_parts(white[whitening.rows[i]], n_bins, c) for i in (first, second))
        levels.append((0.5 * (one - two) ** 2).mean(axis=1))
    if not levels:
        return None
    shortest = min(map(len, levels))
    return np.mean([item[:shortest] for item in levels], axis=0)


def _bin_power_parts(white: Array, n_bins: int, c: int) -> Array:
    """``(n_bins, 2 c)`` real and imaginary parts of a trial's whitened bins; those of a constant are real."""
    n_all = (len(white) + c) // (2 * c)
    real = white[: c * n_all].reshape(n_all, c)
    imaginary = np.vstack([real[:1], white[c * n_all :].reshape(n_all - 1, c)])
    return np.hstack([real, imaginary])[:n_bins]


def make_whitening(record: FloatingRecord, state: State) -> Whitening:
    """Noise model from what cannot hold any effect: readings above the band, predictions at its upper edge.

    ``S(f) = A + C + B (f/f0)^4``: A, white noise of the sensors; B, noise of the kinematics, differentiated
    twice; C, what the same noise does to gravity and to the sensors' levers.

    Args:
        state: the nominal state, whose predictions carry the kinematics' noise.
    """
    sensors = state.white_noise * record.rate_hz / record.full_rate_hz
    kinematics, centre = _noise_above_motion(record, state.predicted_forces)
    sensors = sensors + _pose_noise(record, state)
    factors, tapers, rows, start = [], [], [], 0
    for span in record.spans:
        taper, frequency = _taper_and_frequency(record, span)
        frequency = frequency[frequency <= BAND_HZ]
        noise = sensors + kinematics * (frequency[:, None, None] / centre) ** 4
        # Real and imaginary part share a bin's power, except at zero frequency.
        noise[1:] *= 0.5
        factors.append(np.linalg.inv(np.linalg.cholesky(noise)))
        tapers.append(taper)
        stop = start + (2 * len(frequency) - 1) * len(sensors)
        rows.append(slice(start, stop))
        start = stop
    return Whitening(record, tuple(factors), tuple(tapers), tuple(rows))


def _taper_and_frequency(record: FloatingRecord, span: slice) -> tuple[Array, Array]:
    n = span.stop - span.start
    # scipy.signal takes 0.4 s to load, and an arm's diagnosis, which loads this module too, needs none of it.
    from scipy.signal.windows import tukey

    taper: Array = tukey(n, 0.1)
    frequency = np.asarray(np.fft.rfftfreq(n, 1.0 / record.rate_hz), dtype=float)
    return taper / np.sqrt((taper**2).sum()), frequency


def _noise_above_motion(record: FloatingRecord, values: Array, order: int = 2) -> tuple[Array, float]:
    """``(k, k)`` spectrum of ``values (n, k)`` where no motion is left, at the band's centre, and that [Hz].

    Args:
        values: signals.
        order: their noise grows with this power of frequency.
    """
    low, high = _NOISE_BAND_HZ
    centre = float(np.sqrt(low * high))
    pieces = []
    for span in record.spans:
        taper, frequency = _taper_and_frequency(record, span)
        inside = (frequency >= low) & (frequency <= high)
        smooth = values[span] - values[span].mean(axis=0)
        spectrum = np.fft.rfft(smooth * taper[:, None], axis=0)[inside]
        pieces.append(spectrum * (centre / frequency[inside, None]) ** order)
    spectrum = np.concatenate(pieces)
    return (spectrum.conj().T @ spectrum).real / len(spectrum), centre


def _pose_noise(record: FloatingRecord, state: State) -> Array:
    """``(c, c)`` noise of the residual that white noise of all positions brings, accelerations left out."""
    # Rotations of the base are small, so that the quaternion's vector part is half the rotation.
    positions = np.hstack([state.q[:, :3], 2.0 * state.q[:, 3:6], state.q[:, 7:]])
    power = np.diag(_noise_above_motion(record, positions, order=0)[0])
    few = slice(None, None, 8)
    nominal = _select_samples(state, few).residual
    total = np.zeros((nominal.shape[1], nominal.shape[1]))
    for i, variance in enumerate(power):
        q = state.q[few].copy()
        step = 1e-4
        if 3 <= i < 6:
            q[:, i] += 0.5 * step
            q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
        else:
            q[:, i + (i >= 6)] += step
        change = (_select_samples(state, few).replace(q=q).residual - nominal) / step
        total += variance * change.T @ change / len(change)
    return total


def _select_samples(state: State, few: slice) -> State:
    return state.replace(
        q=state.q[few],
        v=state.v[few],
        a=state.a[few],
        readings={name: values[few] for name, values in state.readings.items()},
    )


# The band that the diagnosis looks at.


def in_band(record: FloatingRecord, values: Array, below_hz: float = BAND_HZ) -> Array:
    """``(n, k)`` without what is above the band that the diagnosis looks at, or above ``below_hz``; ends faded out.

    A sharp edge in frequency, so that the noise model, which is for the band alone, says what noise is left.
    """
    out = []
    for span in record.spans:
        taper, frequency = _taper_and_frequency(record, span)
        spectrum = np.fft.rfft(values[span] * (taper * np.sqrt(len(taper)))[:, None], axis=0)
        spectrum[frequency > below_hz] = 0.0
        out.append(np.fft.irfft(spectrum, len(taper), axis=0))
    return np.concatenate(out)
