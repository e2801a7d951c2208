"""Whether time stamps say when samples were taken, and how much the sampling itself jitters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array

# A regular clock is believed only where it makes positions clearly smoother than the stamps do.
_CLEARLY = 0.95


@dataclass(frozen=True, eq=False)
class Clock:
    """When samples were taken, as positions tell it.

    Attributes:
        time: ``(n,)`` the stamps, or the regular clock behind them where that fits the positions better [s].
        regular: whether it is the regular one: stamps were put on late, by a reader that was kept waiting.
        jitter_s: standard deviation of the sampling instants about ``time`` that positions betray [s].
        noise: ``(n_channels,)`` standard deviation of what no jitter explains [rad or m].
    """

    time: Array
    regular: bool
    jitter_s: float
    noise: Array

    def summary(self) -> str:
        """One line."""
        which = (
            "a regular clock, which fits the positions better than the stamps" if self.regular else "stamps"
        )
        return f"{which}; sampling jitter {1e6 * self.jitter_s:.0f} µs"


def find_clock(time: Array, positions: Array) -> Clock:
    """Choose between stamps and the regular clock behind them, and estimate the jitter that remains.

    A sample taken ``δ`` late shows in a moving joint as an error ``v δ``: squared misfits grow with the
    squared velocity, at a rate that is the jitter's variance and that all joints share.

    Args:
        time: ``(n,)`` strictly increasing stamps [s].
        positions: ``(n, n_channels)``.

    Returns:
        The clock.
    """
    regular = regular_clock(time)
    misfits = [cubic_misfit(instants, positions) for instants in (time, regular)]
    sizes = [float(np.sqrt(np.mean(values**2))) for values in misfits]
    late = sizes[1] < _CLEARLY * sizes[0]
    chosen = regular if late else time
    velocity = np.gradient(positions, chosen, axis=0)[2:-2]
    jitter, noise = _split_variances(misfits[late], velocity)
    return Clock(chosen, late, jitter, noise)


def regular_clock(time: Array) -> Array:
    """Regular instants nearest to the stamps; gaps of several intervals stay, ``(n,)`` [s]."""
    steps, n = np.diff(time), len(time)
    # Over many intervals, as stamps that come late make single ones too long and too short.
    stride = max(1, min(50, n // 4), n // 20)
    interval = float(np.median(time[stride:] - time[:-stride])) / stride
    missing = round(float(time[-1] - time[0]) / interval) - (n - 1)
    extra = np.zeros(n - 1)
    for step in np.argsort(-steps, kind="stable"):
        if missing <= 0:
            break
        extra[step] = min(missing, max(1, round(float(steps[step]) / interval) - 1))
        missing -= int(extra[step])
    count = np.arange(n) + np.concatenate([[0.0], np.cumsum(extra)])
    slope, start = np.polyfit(count, time - time[0], 1)
    return np.asarray(time[0] + start + slope * count)


def cubic_misfit(time: Array, values: Array) -> Array:
    """Distance of each sample from the cubic through two neighbours on either side, ``(n − 4, …)``.

    Scaled so that white noise of standard deviation 1 gives 1.
    """
    n = len(time)
    centre = time[2 : n - 2]
    places = [slice(0, n - 4), slice(1, n - 3), slice(3, n - 1), slice(4, n)]
    nodes = np.stack([time[place] for place in places])
    weights = np.ones_like(nodes)
    for i in range(4):
        for j in range(4):
            if i != j:
                weights[i] *= (centre - nodes[j]) / (nodes[i] - nodes[j])
    shape = (-1,) + (1,) * (values.ndim - 1)
    predicted = sum(w.reshape(shape) * values[place] for w, place in zip(weights, places, strict=True))
    scale = np.sqrt(1.0 + (weights**2).sum(axis=0)).reshape(shape)
    return np.asarray((values[2 : n - 2] - predicted) / scale)


def _split_variances(misfits: Array, velocity: Array) -> tuple[float, Array]:
    """Standard deviations of jitter and of each channel's noise, from binned squares."""
    rows, targets = [], []
    channels = misfits.shape[1]
    for channel in range(channels):
        order = np.argsort(np.abs(velocity[:, channel]))
        for part in np.array_split(order, min(20, max(2, len(order) // 20))):
            row = np.zeros(channels + 1)
            square = float(np.mean(misfits[part, channel] ** 2))
            row[0], row[1 + channel] = float(np.mean(velocity[part, channel] ** 2)), 1.0
            # The scatter of a mean square is in proportion to it.
            weight = 1.0 / max(square, 1e-30)
            rows.append(row * weight)
            targets.append(square * weight)
    matrix = np.array(rows)
    scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    # scipy.optimize takes 0.15 s to load, which most commands do not need.
    from scipy.optimize import nnls

    found = nnls(matrix / scale, np.array(targets))[0] / scale
    return float(np.sqrt(found[0])), np.sqrt(found[1:])


# The lag between two groups of channels.


@dataclass(frozen=True, eq=False)
class Lag:
    """How much later one group of channels was logged than the other.

    Attributes:
        lag_s: positive where the measured one is late [s].
        std_s: its standard deviation, for correlated residuals [s].
        correlation: correlation of both, best aligned.
        correlation_before: the same as logged.
        tried_s: ``(k,)`` lags that were tried [s].
        correlations: ``(k,)`` correlation at each.
    """

    lag_s: float
    std_s: float
    correlation: float
    correlation_before: float
    tried_s: Array
    correlations: Array

    @property
    def certain(self) -> bool:
        """Whether the lag differs from zero by more than three standard deviations."""
        return abs(self.lag_s) > 3.0 * self.std_s

    def summary(self) -> str:
        """One line."""
        return (
            f"torques {1e3 * abs(self.lag_s):.2f} ± {1e3 * self.std_s:.2f} ms "
            f"{'later' if self.lag_s >= 0.0 else 'earlier'} than kinematics"
        )


@dataclass(frozen=True, eq=False)
class Shifted:
    """Two groups of channels against each other at one lag.

    Attributes:
        correlation: of both.
        residual: what is left, ``(n, …)``, rows in order of time.
        slope: its change with the lag, per second and of either sign, ``(n, …)``.
    """

    correlation: float
    residual: Array
    slope: Array


def find_peak(correlation: Callable[[int], Shifted], reach: int, rate_hz: float) -> Lag:
    """The lag at which ``correlation`` is greatest.

    Args:
        correlation: of both groups for a lag in samples.
        reach: largest lag [samples].
        rate_hz: samples per second.
    """
    shifts = np.arange(-reach, reach + 1)
    values = np.array([correlation(int(shift)).correlation for shift in shifts])
    best = int(np.argmax(values))
    offset = 0.0
    if 0 < best < len(shifts) - 1:
        left, middle, right = values[best - 1 : best + 2]
        bend = left - 2.0 * middle + right
        offset = 0.5 * float(left - right) / float(bend) if bend < 0.0 else 0.0
        top = float(middle - 0.25 * (left - right) * offset)
    else:
        top = float(values[best])
    found = correlation(int(shifts[best]))
    return Lag(
        lag_s=float(shifts[best] + offset) / rate_hz,
        std_s=_lag_deviation(found.residual, found.slope),
        correlation=top,
        correlation_before=float(values[reach]),
        tried_s=shifts / rate_hz,
        correlations=values,
    )


def _lag_deviation(residual: Array, slope: Array) -> float:
    """Sandwich: variance of ``Σ slope·residual``, neighbours in time correlated, over ``(Σ slope²)²``."""
    n = len(residual)
    score = (residual * slope).reshape(n, -1).sum(axis=1)
    information = float((slope**2).sum())
    if information == 0.0:
        return float("inf")
    spectrum = np.abs(np.fft.rfft(score, 2 * n)) ** 2
    covariances = np.fft.irfft(spectrum)[:n]
    reach = max(1, int(4.0 * (n / 100.0) ** (2.0 / 9.0)) * 4)
    taper = 1.0 - np.arange(1, reach) / reach
    variance = covariances[0] + 2.0 * float(taper @ covariances[1:reach])
    return float(np.sqrt(max(variance, covariances[0] * 1e-3)) / information)
