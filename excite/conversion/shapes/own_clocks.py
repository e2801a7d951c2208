"""Tables whose columns have clocks of their own: time, signal, time, signal, as oscilloscopes of controllers write."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.clock import goes_evenly
from excite.conversion.columns.words import read_clue
from excite.conversion.recording import Column, Stream

# Clocks are one where, in the units of one, what they differ by changes less than this share of a step.
_SAME = 0.05
# Units of time that may stand side by side: seconds, milliseconds, microseconds, nanoseconds.
_UNITS = 1e3


def by_clock(stream: Stream) -> tuple[list[Stream], str]:
    """A stream for each clock of a table in which clocks stand before their signals; a note where there are several.

    TwinCAT's Scope exports each channel so. Read as one table the torques of a slower task went by twice as fast.
    """
    groups = _clock_groups(stream)
    if len(groups) < 2:
        return [stream], ""
    parts: list[tuple[Column, list[Column]]] = []
    for clock, signals in groups:
        same = next((part for part in parts if _are_one(part[0].values, clock.values)), None)
        if same is None:
            parts.append((clock, list(signals)))
        else:
            same[1].extend(signals)
    if len(parts) < 2:
        return [stream], ""
    made = []
    for k, (clock, signals) in enumerate(parts):
        # Not called by the file: ``a_1`` would say what its columns are.
        whole = replace(stream, name=f"part_{k + 1}", columns=(clock, *signals), words={})
        made.append(whole.rows(np.isfinite(clock.values)))
    return (
        made,
        f"{stream.name} has {len(parts)} clocks, each before its signals: {parts[1][0].name} is another one",
    )


def _clock_groups(stream: Stream) -> list[tuple[Column, list[Column]]]:
    """Clocks with the signals behind them; none where the table does not begin with one, or one has no signal."""
    if stream.time is not None or not stream.columns:
        return []
    first = _name_stem(stream.columns[0].name)
    groups: list[tuple[Column, list[Column]]] = []
    for column in stream.columns:
        named = _name_stem(column.name) == first or read_clue(column.name, ()).quantity == "time"
        if named and goes_evenly(column.values):
            groups.append((column, []))
        elif groups:
            groups[-1][1].append(column)
        else:
            return []
    return groups if all(signals for _, signals in groups) else []


def _name_stem(name: str) -> str:
    """A name without the number of its column."""
    return re.sub(r"~\d+$", "", name)


def _are_one(a: Array, b: Array) -> bool:
    """Whether two clocks are one, though perhaps in other units and from another zero."""
    known = np.isfinite(a) & np.isfinite(b)
    if not np.array_equal(np.isfinite(a), np.isfinite(b)) or known.sum() < 2:
        return False
    steps = np.median(np.diff(a[known])), np.median(np.diff(b[known]))
    if min(steps) <= 0.0:
        return False
    unit = _UNITS ** round(float(np.log(steps[1] / steps[0]) / np.log(_UNITS)))
    differ = b[known] / unit - a[known]
    return float(np.ptp(differ)) < _SAME * float(steps[0])
