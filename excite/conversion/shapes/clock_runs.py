"""A clock that started anew within a recording, and rows that were written out of order."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.conversion.assemble import Table
from excite.conversion.columns.clock import find_restarts


def in_runs(table: Table) -> list[Table]:
    """The table in the order of its times, one for each run of its clock."""
    time = table.columns["time"]
    if (np.diff(time) >= 0.0).all():
        # An hour of a humanoid is not held twice.
        return [table]
    known = np.isfinite(time)
    columns = {name: values[known] for name, values in table.columns.items()}
    time = columns["time"]
    edges = [0, *find_restarts(time).tolist(), len(time)]
    if len(edges) == 2:
        return [_in_order(table, time, columns, slice(None), table.name, ())]
    note = f"its clock starts anew {len(edges) - 2} times: each run is a recording of its own"
    return [
        _in_order(table, time, columns, slice(start, end), f"{table.name}_run{k + 1}", (note,))
        for k, (start, end) in enumerate(itertools.pairwise(edges))
    ]


def _in_order(
    table: Table, time: Array, columns: dict[str, Array], rows: slice, name: str, notes: tuple[str, ...]
) -> Table:
    late = int((np.diff(time[rows]) < 0.0).sum())
    order = np.argsort(time[rows], kind="stable") if late else slice(None)
    if late:
        notes = (*notes, f"{late} rows stood after later ones: sorted by their times")
    found = {key: values[rows][order] for key, values in columns.items()}
    return replace(table, name=name, columns=found, notes=(*table.notes, *notes))
