"""Rows in which something was not measured: filled between neighbours where that is sound, else left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.conversion.assemble import Table
from excite.errors import LogError
from excite.logs.signals.resample import resample_smooth

# Longer than this nothing is made up between two samples [s].
_LONGEST_S = 0.05
# A first value that is this many steps from zero was not reached by moving, nor by the noise of a sensor, which is
# less than this share of all that it measures.
_AT_ONCE, _OF_SPREAD = 10.0, 0.02


def whole_rows(table: Table, source: object) -> Table:
    """The table with finite numbers only; short holes of single channels are filled, what remains is left out.

    Raises:
        LogError: no whole row is left.
    """
    time = table.columns["time"]
    known = np.isfinite(time)
    columns = _select_rows(known, table.columns)
    time = columns["time"]
    filled, notes = 0, list(table.notes)
    silent = _silent_rows(columns)
    if silent.any():
        notes.append(
            f"{int(silent.sum())} rows at the ends hold zeros of all joints, which nothing moved to or from: left out"
        )
        columns = _select_rows(~silent, columns)
        time = columns["time"]
    for name, values in columns.items():
        holes = ~np.isfinite(values)
        if not holes.any() or holes.all():
            continue
        there = np.flatnonzero(~holes)
        after = (
            np.clip(np.searchsorted(there, np.flatnonzero(holes)), 1, len(there) - 1)
            if len(there) > 1
            else None
        )
        if after is None:
            continue
        rows = np.flatnonzero(holes)
        # What comes before the first sample or after the last stands between none.
        near = (
            (time[there[after]] - time[there[after - 1]] <= _LONGEST_S)
            & (rows > there[0])
            & (rows < there[-1])
        )
        rows = rows[near]
        columns[name] = values.copy()
        columns[name][rows] = _interpolate_channel(name, time[there], values[there], time[rows])
        filled += len(rows)
    whole = np.ones(len(time), dtype=bool)
    for values in columns.values():
        whole &= np.isfinite(values)
    if whole.sum() < 10:
        empty = [name for name, values in columns.items() if not np.isfinite(values).any()]
        raise LogError(
            f"has {int(whole.sum())} rows in which every channel was measured"
            + (f"; empty are {', '.join(empty[:4])}" if empty else ""),
            source=source,
            remedy="leave the empty columns out by `ignore` in map.yaml",
        )
    if filled:
        notes.append(f"{filled} single values that were missing stand between their neighbours")
    if not whole.all() or not known.all():
        notes.append(f"{int((~whole).sum() + (~known).sum())} rows with missing values were left out")
    return replace(table, columns=_select_rows(whole, columns), notes=tuple(notes))


def _interpolate_channel(name: str, time: Array, values: Array, at: Array) -> Array:
    """A channel between its samples: positions by a spline, as straight lines between them have no accelerations."""
    if not name.startswith("q."):
        return np.interp(at, time, values)
    stamps, first = np.unique(time, return_index=True)
    return resample_smooth(stamps, values[first], at)


def _select_rows(rows: NDArray[np.bool_], columns: dict[str, Array]) -> dict[str, Array]:
    """Columns in some rows; not copied where all are meant."""
    return dict(columns) if rows.all() else {name: values[rows] for name, values in columns.items()}


def _silent_rows(columns: dict[str, Array]) -> NDArray[np.bool_]:
    """Rows before a driver's first message and after its last, in which all joints' values are the zeros of memory."""
    silent = np.zeros(len(columns["time"]), dtype=bool)
    for channel in ("q", "tau", "i"):
        found = [values for name, values in columns.items() if name.startswith(f"{channel}.")]
        if len(found) < 2:
            continue
        if any(values[0] != 0.0 for values in found) and any(values[-1] != 0.0 for values in found):
            continue
        table = np.column_stack(found)
        there = np.flatnonzero((table != 0.0).any(axis=1))
        if not len(there):
            continue
        for rows, first, second in (
            (slice(0, there[0]), there[0], min(there[0] + 1, len(table) - 1)),
            (slice(there[-1] + 1, None), there[-1], max(there[-1] - 1, 0)),
        ):
            # A motion that begins at zero leaves it in steps; a stream that begins is there at once.
            jump, step = np.abs(table[first]).max(), np.abs(table[second] - table[first]).max()
            if jump > _AT_ONCE * step and jump > _OF_SPREAD * np.ptp(table[there[0] :], axis=0).max():
                silent[rows] = True
    return silent
