"""Signed counters that were written without their sign."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.conversion.recording import Column, Recording

# A signal of sixteen bits that changes its sign leaves the middle half of the range empty.
_BITS = (16, 32)


def signed(recording: Recording) -> Recording:
    """The recording with whole numbers of 16 or 32 bits that jump between both ends of their range taken as signed."""
    turned: list[str] = []

    def of(column: Column) -> Column:
        values = column.values
        known = values[np.isfinite(values)]
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
    if not turned:
        return recording
    note = f"{', '.join(turned[:4])}: whole numbers without sign jump by their whole range, and are taken as signed"
    return replace(recording, streams=streams, notes=(*recording.notes, note))


def _jumps(values: np.ndarray, whole: float) -> bool:
    """Whether it goes from one end to the other more than once, as a counter that overflows does not so fast."""
    return int((np.abs(np.diff(values)) > 0.5 * whole).sum()) >= 2
