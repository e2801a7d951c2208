"""What no model can go below: from repeated trials, and from the spectrum above the motion's band."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import ArmTrial
from excite.diagnosis.equations.repeats import on_the_clock_of_the_first
from excite.diagnosis.equations.samples import ArmSamples
from excite.logs.signals.butterworth import noise_bandwidth
from excite.logs.signals.spectrum import welch_spectrum

_ABOVE = (1.5, 3.0)
# Samples of a stretch of measured torques from which it tells a spectrum as a trial does, and without which none tells.
_LONG, _SHORTEST = 128, 16


def spectral_floor(samples: ArmSamples) -> Array:
    """Noise of each torque channel in the rows' band, ``(n_joints,)`` [N·m], from the spectrum right above it.

    The median over Welch's segments of the density between 1.5 and 3 times the band's end, so that single
    jumps do not count, times the band.
    """
    return _floor(samples, [_ABOVE])


def white_floor(samples: ArmSamples) -> Array:
    """The same from where the spectrum is lowest, ``(n_joints,)`` [N·m]: what no fit can go below.

    Friction that changes suddenly reaches far beyond the band; noise does not become less for it further up.
    """
    low, width = _ABOVE[0], _ABOVE[1] - _ABOVE[0]
    count = int((0.45 * samples.rate_hz / samples.bands.rows_hz - low) / width)
    return _floor(samples, [(low + width * k, low + width * (k + 1)) for k in range(max(count, 1))])


def _floor(samples: ArmSamples, bands: Sequence[tuple[float, float]]) -> Array:
    """From the lowest of the densities in several bands, given in multiples of the rows' band."""
    rate = samples.rate_hz
    width = noise_bandwidth(rate, samples.bands.rows_hz)
    high = [min(most * samples.bands.rows_hz, 0.45 * rate) for _, most in bands]
    low = [min(least * samples.bands.rows_hz, 0.7 * top) for (least, _), top in zip(bands, high, strict=True)]
    # Each band holds two frequencies of the spectrum of half a stretch.
    needed = 4.0 * rate / min(top - bottom for bottom, top in zip(low, high, strict=True))
    floors = []
    for j, column in enumerate(samples.index):
        densities = []
        for trial in samples.trials:
            still = np.abs(trial.v[:, column]) < samples.standstill[j]
            for tau in _stretches(trial, j, still, max(_SHORTEST, int(needed) + 1)):
                f, p = welch_spectrum(np.diff(tau), rate, min(256, len(tau) // 2), median=True)
                found = []
                for bottom, top in zip(low, high, strict=True):
                    band = (f > bottom) & (f < top)
                    found.append(float(np.median(p[band] / (2.0 * np.sin(np.pi * f[band] / rate)) ** 2)))
                densities.append(found)
        density = float(np.median(densities, axis=0).min())
        floors.append(np.sqrt(density * 0.5 * rate * width))
    return np.maximum(np.array(floors), 1e-9)


def _stretches(trial: ArmTrial, joint: int, still: NDArray[np.bool_], least: int) -> list[Array]:
    """Torques of a joint in the stretches in which it moves and they were measured, those that are long enough.

    A motor at rest is quiet: its controller sees no noise of velocities, and rows at rest are hardly judged. Where no
    stretch of motion tells a spectrum, those in which torques were measured do, or the trial.

    Args:
        trial: the trial.
        joint: its column.
        still: ``(n,)`` where the joint may as well stand.
        least: samples that tell a spectrum.
    """
    tau = trial.tau[:, joint]
    told = np.ones(len(tau), dtype=np.bool_) if trial.beyond is None else ~trial.beyond[:, joint]
    moving = told.copy()
    for first, last in _runs(still):
        # What is shorter is no rest but a turn of the motion, where friction jumps.
        if last - first >= least:
            moving[first:last] = False
    for use in (moving, told):
        runs = [tau[first:last] for first, last in _runs(use)]
        longest = max((len(run) for run in runs), default=0)
        if longest >= least:
            return [run for run in runs if len(run) >= min(least if use is moving else longest, _LONG)]
    return [tau]


def _runs(use: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Stretches of samples that are used, first and one past the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], use, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def repeat_floor(samples: ArmSamples, residual: Array) -> Array | None:
    """RMS of half the difference of residuals in repeated trials, times √2: ``(n_joints,)`` or None.

    Differences of residuals, not of torques: the same command does not give quite the same motion.
    """
    values = [residual[:, samples.trial_of_row == k] for k in range(len(samples.trials))]
    both = [on_the_clock_of_the_first(repeat, samples.trials, values) for repeat in samples.repeats]
    squares = np.concatenate([0.5 * (again - first) ** 2 for first, again in both], axis=1) if both else None
    return None if squares is None or not squares.size else np.sqrt(squares.mean(axis=1))


def without_drift(samples: ArmSamples, residual: Array, columns: Sequence[Array]) -> Array:
    """Residuals ``(n_joints, n_rows)`` of repeated trials, each less its own multiple of some columns.

    A joint that warms up between two runs of a command differs by another friction or constant: that is no noise.

    Args:
        samples: the samples.
        residual: ``(n_joints, n_rows)`` [N·m].
        columns: by joint, ``(n_rows, n)`` of its friction and constant.
    """
    left = residual.copy()
    for k in {k for repeat in samples.repeats for k in (repeat.first, repeat.again)}:
        rows = samples.trial_of_row == k
        for j, block in enumerate(columns):
            left[j, rows] -= block[rows] @ np.linalg.lstsq(block[rows], residual[j, rows], rcond=None)[0]
    return left


def unrepeated(samples: ArmSamples, noise: Array, rows: NDArray[np.bool_] | None = None) -> Array:
    """Power of a known noise less what it has in the repeated trials, ``(n_joints,)`` [(N·m)²].

    Where noise grows with the posture's inertia, repeats of one trial do not show that of all.

    Args:
        samples: the samples.
        noise: ``(n_joints, n_rows)`` a draw of it [N·m].
        rows: which rows to tell it of; all by default.
    """
    pairs = [(repeat.first, repeat.again) for repeat in samples.repeats]
    if not pairs:
        return np.zeros(len(noise))
    power, shown = noise**2, np.isin(samples.trial_of_row, np.unique(pairs))
    asked = power if rows is None else power[:, rows]
    return np.asarray(asked.mean(axis=1) - power[:, shown].mean(axis=1))


def other_postures(repeat: Array, more: Array | float) -> Array:
    """The floor of repeated trials carried over to others, ``(n_joints,)`` [N·m]; no less than half of it.

    Args:
        repeat: ``(n_joints,)`` floor of the repeated trials [N·m].
        more: ``(n_joints,)`` power of noise in the others less that in the repeated ones [(N·m)²].
    """
    return np.sqrt(np.maximum(repeat**2 + more, 0.25 * repeat**2))
