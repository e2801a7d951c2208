"""Zero-phase low-pass filtering of signals, and how much of white noise it leaves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from excite.arrays import Array, Indices
from excite.errors import LogError
from excite.lazy_kernel import LazyKernel


def lowpass(values: Array, rate_hz: float, cutoff_hz: float, order: int = 4) -> Array:
    """Butterworth low-pass run forwards and backwards: no phase, twice the attenuation.

    The amplitude at ``cutoff_hz`` is one half (−6 dB) whatever the order; use the same call on both sides of
    a regression, so that the filter distorts neither against the other.

    Args:
        values: ``(n, …)`` uniformly sampled, filtered along the first axis.
        rate_hz: sampling rate [Hz].
        cutoff_hz: corner frequency [Hz]; at or above half the rate nothing is filtered.
        order: order of the single pass, 1 or more.

    Returns:
        Filtered values, same shape.

    Raises:
        LogError: the signal is shorter than the filter needs.
    """
    if cutoff_hz >= 0.5 * rate_hz:
        return values.copy()
    needed = settling_samples(rate_hz, cutoff_hz)
    if len(values) <= needed:
        raise LogError(
            f"{len(values)} samples are too few for a {cutoff_hz:g} Hz filter at {rate_hz:g} Hz",
            field="cutoff_hz",
            remedy=f"record at least {needed + 1} samples or raise the cut-off",
        )
    # Point reflections continue the ends with their slope.
    before, after = 2.0 * values[:1] - values[needed:0:-1], 2.0 * values[-1:] - values[-2 : -2 - needed : -1]
    padded = np.concatenate([before, values, after]).reshape(len(values) + 2 * needed, -1)
    end, rows = np.array([len(padded)]), np.arange(needed, needed + len(values))
    sections, states = butterworth_sections(order, rate_hz, cutoff_hz)
    smooth = both_ways(padded, end, rows, np.array([len(rows)]), sections, states)
    return np.ascontiguousarray(smooth).reshape(values.shape)


def settling_samples(rate_hz: float, cutoff_hz: float) -> int:
    """Samples at either end that the filter's transient reaches: two periods of the cut-off.

    The slowest pole of a fourth-order filter has died down to 8e-3 of a step there.
    """
    return 0 if cutoff_hz >= 0.5 * rate_hz else math.ceil(2.0 * rate_hz / cutoff_hz)


def noise_bandwidth(rate_hz: float, cutoff_hz: float, order: int = 4) -> float:
    """Share of white noise's power that passes :func:`lowpass`, in 0…1.

    The integral of the squared amplitude response over frequency relative to half the rate; times the rate
    it is the number of independent samples that filtered noise has in a second.
    """
    if cutoff_hz >= 0.5 * rate_hz:
        return 1.0
    n = 2048
    # The bilinear transform maps the analogue corner exactly, hence the tangents.
    corner = math.tan(math.pi * cutoff_hz / rate_hz)
    total = 0.0
    for k in range(n):
        ratio = math.tan(0.5 * math.pi * (k + 0.5) / n) / corner
        total += (1.0 / (1.0 + ratio ** (2 * order))) ** 2
    return total / n


# Butterworth filters as second-order sections, run forwards and backwards over many signals side by side.

# Signals that go through together: enough for the processor to work on several, few enough for its cache.
SIDE_BY_SIDE = 64


@lru_cache(maxsize=64)
def butterworth_sections(order: int, rate_hz: float, cutoff_hz: float) -> tuple[Array, Array]:
    """Sections of a digital Butterworth low-pass, by the bilinear transform (Oppenheim, Schafer 2010, section 7.2).

    Args:
        order: 1 or more.
        rate_hz: sampling rate [Hz].
        cutoff_hz: corner frequency, below half the rate [Hz].

    Returns:
        ``b0 b1 b2 1 a1 a2`` of each section, ``(n_sections, 6)``, the least damped one last; and the two states of
        each after a constant 1 that has always been there, ``(n_sections, 2)``.
    """
    # Poles of the analogue prototype at a rate of 2, the corner where the transform will bend it to.
    corner = 4.0 * np.tan(np.pi * (2.0 * cutoff_hz / rate_hz) / 2.0)
    analogue = corner * -np.exp(1j * np.pi * np.arange(1.0 - order, order, 2.0) / (2.0 * order))
    poles = ((4.0 + analogue) / (4.0 - analogue))[: (order + 1) // 2]
    sections = [
        [1.0, 2.0, 1.0, 1.0, -2.0 * p.real, p.real * p.real + p.imag * p.imag]
        for p in sorted(poles[: order // 2], key=abs)
    ]
    if order % 2:
        sections.insert(0, [1.0, 1.0, 0.0, 1.0, -poles[-1].real, 0.0])
    made = np.array(sections)
    made[0, :3] *= corner**order * (1.0 / np.prod(4.0 - analogue)).real
    states, gain = np.empty((len(made), 2)), 1.0
    for k, (b0, b1, b2, _, a1, a2) in enumerate(made):
        constant = np.array([[1.0 + a1, -1.0], [a2, 1.0]])
        states[k] = gain * np.linalg.solve(constant, np.array([b1 - a1 * b0, b2 - a2 * b0]))
        gain *= (b0 + b1 + b2) / (1.0 + a1 + a2)
    return made, states


def both_ways(
    values: Array,
    ends: Indices,
    rows: Indices,
    row_ends: Indices,
    sections: Array,
    states: Array,
    weights: Array | None = None,
    weighted: Indices | None = None,
) -> Array:
    """Signals of several trials forwards and backwards through sections, at the rows that are kept.

    All trials go through side by side, each held at its end until the longest has ended; both passes begin as if
    their first value had always been there.

    Args:
        values: ``(n, n_signals)``, all trials below each other.
        ends: ``(n_trials,)`` where each trial ends in ``values``.
        rows: ``(n_rows,)`` samples that are kept, counted from their trial's start, all trials after each other.
        row_ends: ``(n_trials,)`` where each trial ends in ``rows``.
        sections: of :func:`butterworth_sections`, and their ``states``.
        states: after a constant 1.
        weights: ``(n_weights, n)`` what signals are multiplied by before, and ``weighted``, ``(n_signals,)``, by which
            of them each is; None where they go through as they are.

    Returns:
        ``(n_rows, n_signals)``, each signal in one piece.
    """
    if weights is None or weighted is None:
        weights, weighted = np.empty((0, 0)), np.empty(0, dtype=np.int64)
    longest = int(np.diff(ends, prepend=0).max())
    columns = max(1, min(values.shape[1], SIDE_BY_SIDE))
    trials = min(len(ends), max(1, SIDE_BY_SIDE // columns))
    room = np.empty((longest, trials * columns))
    out = np.empty((values.shape[1], len(rows)))
    # Of signals in one piece each a few are laid out at a time: a line of the cache holds eight numbers.
    pieces = values.flags.f_contiguous
    values, at_once = (values, 8) if pieces else (np.ascontiguousarray(values), columns)
    _filter_block(
        values, weights, weighted, ends, rows, row_ends, sections, states, columns, at_once, room, out
    )
    return out.T


@LazyKernel
def _filter_block(
    values, weights, weighted, ends, rows, row_ends, sections, states, columns, at_once, room, out
):  # pragma: no cover - compiled
    """:func:`both_ways`, so many columns of so many trials at a time as there is ``room`` for.

    ``room`` is ``(n, n_trials_at_a_time·columns)``; where fewer are left, what is in it goes through again.
    """
    n_trials, n_signals, longest = len(ends), values.shape[1], len(room)
    at_a_time = room.shape[1] // columns
    for column in range(0, n_signals, columns):
        width = min(columns, n_signals - column)
        for trial in range(0, n_trials, at_a_time):
            last = min(trial + at_a_time, n_trials)
            for k in range(trial, last):
                start = ends[k - 1] if k else 0
                n, place = ends[k] - start, (k - trial) * columns
                _lay_out_signals(values, weights, weighted, start, n, column, at_once, room, place, width)
            _run_sections(room, sections, states, 0, 1)
            _run_sections(room, sections, states, longest - 1, -1)
            for k in range(trial, last):
                for row in range(row_ends[k - 1] if k else 0, row_ends[k]):
                    for c in range(width):
                        out[column + c, row] = room[rows[row], (k - trial) * columns + c]


@LazyKernel
def _lay_out_signals(
    values, weights, weighted, start, n, column, at_once, room, place, width
):  # pragma: no cover - compiled
    """Lay a trial's signals out in ``room`` from column ``place`` on, times their weights, held at its end."""
    for group in range(0, width, at_once):
        until = min(group + at_once, width)
        if len(weights):
            for i in range(n):
                for c in range(group, until):
                    weight = weights[weighted[column + c], start + i]
                    room[i, place + c] = values[start + i, column + c] * weight
        else:
            for i in range(n):
                for c in range(group, until):
                    room[i, place + c] = values[start + i, column + c]
    for i in range(n, len(room)):
        for c in range(width):
            room[i, place + c] = room[n - 1, place + c]


@LazyKernel
def _run_sections(signals, sections, states, begin, step):  # pragma: no cover - compiled
    """Signals ``(n, n_signals)`` through the sections in place, in one direction (direct form II transposed)."""
    n, width = signals.shape
    memory = np.empty((len(sections), 2, width))
    for s in range(len(sections)):
        for c in range(width):
            memory[s, 0, c], memory[s, 1, c] = (
                states[s, 0] * signals[begin, c],
                states[s, 1] * signals[begin, c],
            )
    for k in range(n):
        row = signals[begin + step * k]
        for s in range(len(sections)):
            b0, b1, b2, a1, a2 = (
                sections[s, 0],
                sections[s, 1],
                sections[s, 2],
                sections[s, 4],
                sections[s, 5],
            )
            one, two = memory[s, 0], memory[s, 1]
            for c in range(width):
                x = row[c]
                y = b0 * x + one[c]
                one[c] = b1 * x - a1 * y + two[c]
                two[c] = b2 * x - a2 * y
                row[c] = y


# Fewer samples, after a filter that leaves nothing that they could alias.


def decimation_step(rate_hz: float, target_hz: float) -> int:
    """Every how manieth sample is kept so that at least ``target_hz`` [Hz] remain."""
    return max(1, int(rate_hz / target_hz + 1e-9))


def kept_samples(n: int, step: int) -> Indices:
    """Indices of the samples that stay, the first half a step from the start."""
    return np.arange(step // 2, n, step)


# Velocities and accelerations from positions.

# Central differences of sixth order: weights of the third, second and first neighbours, and of the sample itself.
_FIRST = np.array([-1.0, 9.0, -45.0]) / 60.0
_SECOND, _ITSELF = np.array([2.0, -27.0, 270.0]) / 180.0, -490.0 / 180.0


@dataclass(frozen=True, eq=False)
class Derivatives:
    """A signal and its first two derivatives, each ``(n, …)``.

    Attributes:
        value: the signal.
        first: per second.
        second: per second squared.
    """

    value: Array
    first: Array
    second: Array


def central_differences(values: Array, rate_hz: float) -> Derivatives:
    """Sixth-order central differences of a uniformly sampled signal.

    The error of the first derivative of a sine of frequency f is ``(2πf/rate)^6/140`` of its amplitude,
    that of the second ``(2πf/rate)^6/560``. The ends are continued by point reflection, so that the three
    outermost samples on either side are of low order.

    Args:
        values: ``(n, …)``, n at least 4.
        rate_hz: sampling rate [Hz].

    Returns:
        The signal and its derivatives.
    """
    before = 2.0 * values[:1] - values[3:0:-1]
    after = 2.0 * values[-1:] - values[-2:-5:-1]
    padded, n = np.concatenate([before, values, after]), len(values)
    first, second = np.zeros_like(padded[:n]), _ITSELF * values
    for k, (slope, bend) in enumerate(zip(_FIRST, _SECOND, strict=True)):
        left, right = padded[k : k + n], padded[6 - k : 6 - k + n]
        first += (left - right) * slope
        second += (left + right) * bend
    return Derivatives(values, first * rate_hz, second * rate_hz**2)
