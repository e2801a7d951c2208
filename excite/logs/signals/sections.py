"""Butterworth filters as second-order sections, run forwards and backwards over many signals side by side."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.lazy_kernel import LazyKernel

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
    ends: NDArray[np.int64],
    rows: NDArray[np.int64],
    row_ends: NDArray[np.int64],
    sections: Array,
    states: Array,
    weights: Array | None = None,
    weighted: NDArray[np.int64] | None = None,
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
