"""Rows in which something was not measured: filled between neighbours where that is sound, else left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.conversion.assemble import Table
from excite.errors import LogError

# Longer than this nothing is made up between two samples [s].
_LONGEST_S = 0.05


def whole_rows(table: Table, source: object) -> Table:
    """The table with finite numbers only; short holes of single channels are filled, what remains is left out.

    Raises:
        LogError: no whole row is left.
    """
    time = table.columns["time"]
    known = np.isfinite(time)
    columns = {name: values[known] for name, values in table.columns.items()}
    time = columns["time"]
    filled, notes = 0, list(table.notes)
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
        columns[name][rows] = np.interp(time[rows], time[there], values[there])
        filled += len(rows)
    whole = np.all([np.isfinite(values) for values in columns.values()], axis=0)
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
    return replace(
        table, columns={name: values[whole] for name, values in columns.items()}, notes=tuple(notes)
    )
