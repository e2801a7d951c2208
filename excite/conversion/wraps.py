"""Whole numbers at the ends of their range: signed ones written without their sign, clocks that began at zero again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.clock import is_clock
from excite.conversion.recording import Column, Recording

# A signal of sixteen bits that changes its sign leaves the middle half of the range empty.
_BITS = (16, 32)
_CLOCK_BITS = (16, 24, 32)
# A clock passes its end seldom, and loses no more rows there than elsewhere.
_RARE, _GAP = 0.01, 50.0


def signed(recording: Recording) -> Recording:
    """The recording with whole numbers of 16 or 32 bits that jump between both ends of their range taken as signed."""
    turned: list[str] = []
    wrapped: list[str] = []

    def of(column: Column) -> Column:
        values = column.values
        known = values[np.isfinite(values)]
        whole_clock = _continued(known) if len(known) == len(values) else None
        if whole_clock is not None:
            wrapped.append(column.name)
            return replace(column, values=whole_clock)
        if not len(known) or known.min() < 0.0 or known.max() < 2.0**15 or (known != np.round(known)).any():
            return column
        for bits in _BITS:
            whole = 2.0**bits
            high, low = known > 0.75 * whole, known < 0.25 * whole
            if (
                known.max() < whole
                and high.any()
                and low.any()
                and (high | low).all()
                and _jumps(known, whole)
            ):
                turned.append(column.name)
                return replace(column, values=np.where(values > 0.5 * whole, values - whole, values))
        return column

    streams = tuple(replace(s, columns=tuple(of(c) for c in s.columns)) for s in recording.streams)
    if turned:
        # Another joint's, of the same driver, may be negative all the time.
        streams = tuple(replace(s, columns=tuple(_negative(c, turned) for c in s.columns)) for s in streams)
    if not turned and not wrapped:
        return recording
    notes = list(recording.notes)
    if turned:
        notes.append(
            f"{', '.join(turned[:4])}: whole numbers without sign jump by their whole range, and are taken as signed"
        )
    if wrapped:
        notes.append(f"{', '.join(wrapped[:4])}: a counter that began at zero again goes on here")
    return replace(recording, streams=streams, notes=tuple(notes))


def _negative(column: Column, turned: list[str]) -> Column:
    """A column that never leaves the upper end of its range as signed, where others of its driver were."""
    known = column.values[np.isfinite(column.values)]
    if not len(known) or (known != np.round(known)).any() or is_clock(known):
        return column
    for bits in _BITS:
        whole = 2.0**bits
        if known.min() > 0.75 * whole and known.max() < whole:
            turned.append(column.name)
            return replace(column, values=column.values - whole)
    return column


def _continued(values: Array) -> Array | None:
    """A clock of whole ticks that went over the end of its range, going on; None where it is none."""
    steps = np.diff(values)
    back = steps < 0.0
    if not back.any() or back.mean() > _RARE or (values != np.round(values)).any() or values.min() < 0.0:
        return None
    usual = float(np.median(steps))
    for bits in _CLOCK_BITS:
        mended = steps[back] + 2.0**bits
        if values.max() < 2.0**bits and usual > 0.0 and (mended >= 0.0).all() and mended.max() < _GAP * usual:
            whole = values + 2.0**bits * np.concatenate([[0.0], np.cumsum(back)])
            return np.asarray(whole) if is_clock(whole) else None
    return None


def _jumps(values: np.ndarray, whole: float) -> bool:
    """Whether it goes from one end to the other more than once, as a counter that overflows does not so fast."""
    return int((np.abs(np.diff(values)) > 0.5 * whole).sum()) >= 2
