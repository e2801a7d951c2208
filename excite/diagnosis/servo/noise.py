"""Noise of torques that a servo must have asked for: its encoders' noise, and what the servo makes of it."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.servo.servo import BAND_HZ, Servo

# Where the spectral floor is measured, in multiples of the rows' band.
_ABOVE = (1.5, 3.0)


def servo_floor(samples: ArmSamples, servo: Servo, order: list[int]) -> Array:
    """Noise in the rows' band, ``(n_joints,)`` [N·m], of torques rebuilt from positions.

    Above the band the noise is measured; below it is what the servo makes of encoders whose noise is white: it
    grows with the frequency as ``|kp + i 2πf kd|``, by several times within a decade where kd/kp is long. A floor
    that took it for flat would hide all that is weak. An integral part makes a random walk of it, of which each trial's
    mean is taken off: ``ki² S T/12`` is left of it after a time T, S the density of the encoders' noise.

    Args:
        samples: trials with torques rebuilt with this servo.
        servo: the servo.
        order: of the samples' joints in the log.

    Returns:
        The floor.
    """
    rate, rows_hz = samples.rate_hz, samples.bands.rows_hz
    f = np.linspace(0.0, 0.5 * rate, 2000)[1:]
    kp, kd = servo.kp[order], servo.kd[order]
    grown = kp**2 + (2.0 * np.pi * f[:, None] * kd) ** 2
    grown *= _passed(f, BAND_HZ, rate)[:, None]
    high = min(_ABOVE[1] * rows_hz, 0.45 * rate)
    low = min(_ABOVE[0] * rows_hz, 0.7 * high)
    above = np.median(grown[(f > low) & (f < high)], axis=0)
    passed = _passed(f, rows_hz, rate)[:, None]
    share = np.minimum((grown * passed).sum(axis=0) / (above * passed.sum()), 1.0)
    if servo.ki is not None:
        seconds = np.mean([t.time[-1] - t.time[0] for t in samples.trials])
        share += servo.ki[order] ** 2 * seconds / 12.0 / (above * passed.sum() * (f[1] - f[0]))
    return np.asarray(spectral_floor(samples) * np.sqrt(share))


def _passed(f: Array, cutoff_hz: float, rate_hz: float) -> Array:
    """Share of the power at ``f`` [Hz] that a fourth-order Butterworth filter run both ways lets through."""
    if cutoff_hz >= 0.5 * rate_hz:
        return np.ones_like(f)
    warped = np.tan(np.pi * np.minimum(f, 0.4999 * rate_hz) / rate_hz) / np.tan(np.pi * cutoff_hz / rate_hz)
    return 1.0 / (1.0 + warped**8) ** 2
