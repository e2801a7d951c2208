"""Times of which one column holds the seconds and the next one what is beyond them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.clock import is_clock
from excite.conversion.recording import Column, Stream

# Nanoseconds, microseconds, milliseconds of a second.
_PARTS = (1e9, 1e6, 1e3)
# Of a recording of some seconds the parts come near both ends of a second.
_LEAST, _MOST = 0.2, 0.8


def with_whole_stamps(stream: Stream) -> tuple[Stream, str]:
    """The stream with one clock for every pair of columns that are whole seconds and parts of them, and a note."""
    if stream.time is not None:
        return stream, ""
    columns: list[Column] = []
    done = []
    for column in stream.columns:
        before = columns[-1] if columns else None
        whole = None if before is None or before.channel else _join_stamps(before.values, column.values)
        if before is None or whole is None:
            columns.append(column)
            continue
        name = f"{before.name}+{column.name}"
        columns[-1] = Column(name, whole, channel="time", unit="s")
        done.append(name)
    note = f"{', '.join(done)}: seconds and parts of a second are one time" if done else ""
    return replace(stream, columns=tuple(columns)), note


def _join_stamps(seconds: Array, parts: Array) -> Array | None:
    """Seconds with their parts; None where these columns are no such pair."""
    known = np.isfinite(seconds) & np.isfinite(parts)
    if known.sum() < 3:
        return None
    s, p = seconds[known], parts[known]
    steps = np.diff(s)
    if (s != np.round(s)).any() or (p != np.round(p)).any() or p.min() < 0.0 or not (steps > 0.0).any():
        return None
    if (steps > 0.0).mean() > 0.5:
        # Seconds that go on in most rows need no parts.
        return None
    scale = next((one for one in reversed(_PARTS) if p.max() < one), None)
    if scale is None or p.max() < _MOST * scale or p.min() > _LEAST * scale:
        return None
    whole = seconds + parts / scale
    return np.asarray(whole) if is_clock(whole) and (np.diff(p) < 0.0).any() else None
