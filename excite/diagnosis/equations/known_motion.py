"""Up to which frequency positions tell a motion well enough: noise in accelerations bends what is fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import Bands
from excite.logs.log import Log, Trial
from excite.logs.signals.butterworth import noise_bandwidth
from excite.logs.signals.spectrum import welch_spectrum
from excite.rows.kinematics import positions_on_grid, trial_grid, trial_rate

# White noise is seen between this multiple of the kinematics' band and this share of the rate; of slow records, whose
# band is wider than their spectrum, in the upper third below that.
_ABOVE, _BELOW = 1.3, 0.45
_SEGMENT, _SEGMENT_S = 256, 4.0
# Nats that noise of a joint's acceleration may feign by itself. What other columns explain of a column is lost to its
# signal and not to its noise, so that in a fit of whole bodies the same noise feigns tens of times as much. Of 14 arms
# and recordings with encoders of 12 to 18 bits a turn (Z1, UR10, ARX5, Sawyer, Panda, xArm7) six had false soft gears
# or constants with 3 here, none with 0.3 or with 0.1; what was there kept its name with all of them. Without the rule a
# Fetch's lift had a constant of 111 N firmly, with 0.1 mm of noise on its position.
_FEIGNED = 0.3
# Factor between the bands that are tried, and the lowest [Hz]; settled ends may be no more than half of a trial.
_STEP, _LOWEST_HZ, _SETTLING = 1.25, 1.0, 8.0


def noise_density(positions: Sequence[Array], rate_hz: float, band_hz: float) -> Array:
    """Density of the white noise of positions, ``(n,)`` [rad²/Hz or m²/Hz]: as if it were flat below what is seen.

    The median over Welch's segments of the density above the band of the motion; third differences keep the motion
    from leaking into it.

    Args:
        positions: ``(n_samples, n)`` a trial, uniform.
        rate_hz: of the samples.
        band_hz: end of the kinematics' band.
    """
    high = _BELOW * rate_hz
    low = min(_ABOVE * band_hz, 2.0 * high / 3.0)
    found = []
    for q in positions:
        f, p = welch_spectrum(np.diff(q, 3, axis=0), rate_hz, min(_SEGMENT, len(q) // 2), median=True)
        band = (f > low) & (f < high)
        found.append(np.median(p[band] / (2.0 * np.sin(np.pi * f[band] / rate_hz))[:, None] ** 6, axis=0))
    return np.asarray(np.median(found, axis=0))


def bands_by_noise(log: Log, trials: Sequence[Trial]) -> Bands:
    """Bands of the comparison: lower where the noise of positions would bend what is fitted.

    Noise in a regressor bends its coefficient towards zero by the noise's share of the regressor's power (Fuller,
    Measurement Error Models, 1987, section 1.1), and what the coefficient lacks another column takes over: of a slow
    lift's weight a part becomes a constant torque. With n effective rows a share λ feigns n λ/2 nats. The noise of an
    acceleration grows with the fifth power of the band, so a lower one ends that; a joint that nobody can tell moving
    at any of them has no say.

    Args:
        log: the log.
        trials: repaired trials.
    """
    bands = Bands()
    rate = float(np.median([trial_rate(log.header, trial) for trial in trials]))
    positions = [positions_on_grid(t.time, t.q, trial_grid(t, rate)) for t in trials]
    noise = noise_density(positions, rate, bands.kinematics_hz)
    if not noise.any():
        return bands
    shortest = min(len(q) for q in positions)
    least = max(_LOWEST_HZ, _SETTLING * rate / shortest)
    tried = [bands.rows_hz]
    while tried[-1] / _STEP >= least:
        tried.append(tried[-1] / _STEP)
    f, seen = _accelerations(positions, rate)
    false = (2.0 * np.pi * f[:, None]) ** 4 * noise
    seconds = sum(len(q) for q, t in zip(positions, trials, strict=True) if t.role == "identification") / rate
    feigned = np.empty((len(tried), len(noise)))
    for row, end in zip(feigned, tried, strict=True):
        inside = f <= end
        power = false[inside].sum(axis=0)
        motion = (seen - false)[inside].sum(axis=0)
        effective = seconds * rate * noise_bandwidth(rate, end)
        row[:] = 0.5 * effective * power / np.maximum(motion, 1e-9 * np.maximum(power, 1e-300))
        row[motion < power] = np.inf
    known = np.isfinite(feigned).any(axis=0)
    worst = feigned[:, known].max(axis=1, initial=0.0)
    good = np.flatnonzero(worst <= _FEIGNED)
    end = tried[int(good[0] if len(good) else np.argmin(worst))]
    return replace(bands, rows_hz=end, kinematics_hz=bands.kinematics_hz * end / bands.rows_hz)


def _accelerations(positions: Sequence[Array], rate_hz: float) -> tuple[Array, Array]:
    """Frequencies ``(m,)`` [Hz] and density of accelerations ``(m, n)`` there, over all trials, noise included.

    The least of what positions and their differences show: slow motion leaks upwards in the ones, noise downwards in
    the others.
    """
    length = min(round(_SEGMENT_S * rate_hz), *(len(q) // 2 for q in positions))
    weight = np.array([len(q) for q in positions], dtype=float)
    f = np.arange(1.0, length // 2 + 1.0) * (rate_hz / length)
    bent = (2.0 * rate_hz * np.sin(np.pi * f[:, None] / rate_hz)) ** 2
    found = []
    for order in range(3):
        parts = [welch_spectrum(np.diff(q, order, axis=0), rate_hz, length)[1][1:] for q in positions]
        density = np.tensordot(weight / weight.sum(), np.array(parts), axes=1)
        found.append(density * (2.0 * np.pi * f[:, None]) ** 4 * rate_hz ** (2 * order) / bent**order)
    return np.asarray(f, dtype=np.float64), np.asarray(np.min(found, axis=0))
