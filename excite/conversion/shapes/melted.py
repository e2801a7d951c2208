"""Tables of one value a row, as data bases and data frames give them out: which signal it is of stands beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.conversion.columns.words import name_tokens, read_clue
from excite.conversion.recording import Column, Stream

_VALUES = frozenset("value values val data number reading y".split())
# Signals of a humanoid with hands, measured and commanded; rows of each that are worth a table.
_MOST, _FEWEST = 400, 10


def spread_signals(stream: Stream) -> tuple[Stream, str]:
    """The stream with a column a signal, where each row has one value and words that say of which signal; a note.

    Signals need not have been written at the same times: rows are those of all of them, empty where one has none.
    """
    parts = _time_and_value(stream)
    if parts is None:
        return stream, ""
    time, value = parts
    text, keys = _row_labels(stream)
    labels, which = np.unique(text, return_inverse=True)
    there = np.isfinite(time.values)
    if not 1 < len(labels) <= _MOST or not any(read_clue(str(label), ()).quantity == "q" for label in labels):
        return stream, ""
    if np.bincount(which[there], minlength=len(labels)).min() < _FEWEST:
        return stream, ""
    times, place = np.unique(time.values[there], return_inverse=True)
    table = np.full((len(labels), len(times)), np.nan)
    table[which[there], place] = value.values[there]
    columns = [replace(time, values=times)]
    columns += [Column(str(label), row) for label, row in zip(labels, table, strict=True)]
    note = f"{' and '.join(keys)} say which signal a row is of: {len(labels)} signals, a column each here"
    return replace(stream, columns=tuple(columns), words={}), note


def _time_and_value(stream: Stream) -> tuple[Column, Column] | None:
    """The columns of times and of values; None where there is more than one of either, or no word beside them."""
    if stream.time is not None or stream.nameless or not stream.words:
        return None
    varying = [column for column in stream.columns if _has_variation(column.values)]
    times = [column for column in varying if read_clue(column.name, ()).quantity == "time"]
    values = [column for column in varying if set(name_tokens(column.name)) <= _VALUES]
    return (times[0], values[0]) if len(times) == 1 and len(values) == 1 else None


def _row_labels(stream: Stream) -> tuple[NDArray[np.str_], list[str]]:
    """What the words of each row say together, and the names of the columns that they stand in."""
    said = {name: np.array([str(cell or "") for cell in cells]) for name, cells in stream.words.items()}
    keys = [name for name, cells in said.items() if len(cells) and (cells != cells[0]).any()]
    text = np.array([""] * stream.n_rows) if not keys else said[keys[0]]
    for name in keys[1:]:
        text = np.char.add(np.char.add(text, "."), said[name])
    return text, keys


def _has_variation(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 0 and float(np.ptp(known)) > 0.0
