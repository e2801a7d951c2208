"""Long tables: a row a joint and sample, or a row a quantity and sample, with a column that says which."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.conversion.columns.clock import is_clock
from excite.conversion.columns.words import read_clue
from excite.conversion.recording import Column, Stream

_KEYS = frozenset("joint joints name motor motors id axis actuator servo dof".split())
# Joints of a humanoid with hands; samples that are worth a table; how unequal joints' rows may be.
_MOST, _FEWEST, _UNEQUAL = 100, 10, 0.02


def widen_table(stream: Stream) -> tuple[Stream, str]:
    """The stream with a column for each joint of ``position`` … where a column names the joint of its row; a note."""
    if len(stream.columns) > _MOST:
        return stream, ""
    for name, cells in _key_columns(stream).items():
        found = _rows_by_key(cells)
        if found is None:
            continue
        labels, rows = found
        if name in stream.words and _are_quantities(labels):
            return _a_row_a_quantity(stream, name, labels, rows)
        if not _is_key(name):
            continue
        columns: list[Column] = []
        for column in stream.columns:
            if column.name == name:
                continue
            table = column.values[rows]
            if (table == table[0]).all() or all(is_clock(values) for values in table):
                columns.append(replace(column, values=table[0]))
            else:
                columns += [
                    replace(column, name=f"{column.name}.{label}", values=values, label=label)
                    for label, values in zip(labels, table, strict=True)
                ]
        time = None if stream.time is None else stream.time[rows[0]]
        note = f"{name} names the joint of each row: {len(labels)} rows a sample, a column a joint here"
        return replace(stream, columns=tuple(columns), words={}, time=time), note
    return stream, ""


def _are_quantities(labels: list[str]) -> bool:
    """Whether each names a quantity, positions among them, and no two the same one."""
    said = [read_clue(label, ()) for label in labels]
    named = {(one.quantity, one.commanded) for one in said if one.quantity not in ("", "skip")}
    return ("q", False) in named and len(named) == len(labels)


def _a_row_a_quantity(
    stream: Stream, name: str, labels: list[str], rows: NDArray[np.int64]
) -> tuple[Stream, str]:
    """A column a joint and quantity, of lines that begin with ``Position``, ``Velocity``, ``Torque`` in turn."""
    columns: list[Column] = []
    for column in stream.columns:
        values = column.values[rows]
        if all(is_clock(one) for one in values):
            columns.append(replace(column, values=values[0]))
            continue
        at = len(columns) // len(labels)
        columns += [
            replace(
                column, name=f"{label}[{at}]" if stream.nameless else f"{label}.{column.name}", values=one
            )
            for label, one in zip(labels, values, strict=True)
        ]
    time = None if stream.time is None else stream.time[rows[0]]
    note = f"{name} names the quantity of each row: {', '.join(labels)}"
    return replace(stream, columns=tuple(columns), words={}, time=time, nameless=False), note


def _key_columns(stream: Stream) -> dict[str, NDArray[np.object_]]:
    """Columns that may say which joint or quantity a row is of."""
    numbers = {
        column.name: np.array([f"{value:g}" for value in column.values], object)
        for column in stream.columns
        if _is_key(column.name) and _is_count(column.values)
    }
    return dict(stream.words) | numbers


def _is_key(name: str) -> bool:
    words = [word for word in re.split(r"[^a-z]+", name.lower()) if word]
    return bool(words) and set(words) <= _KEYS and not re.search(r"\d", name)


def _is_count(values: Array) -> bool:
    return bool(np.isfinite(values).all() and (values == np.round(values)).all() and np.ptp(values) <= _MOST)


def _rows_by_key(cells: NDArray[np.object_]) -> tuple[list[str], NDArray[np.int64]] | None:
    """Labels in their order, and ``(joints, samples)`` rows; None where rows do not go round the joints."""
    text = np.array([str(cell) for cell in cells])
    labels = list(dict.fromkeys(text[: 10 * _MOST].tolist()))
    if not 1 < len(labels) <= _MOST or len(text) < _FEWEST * len(labels):
        return None
    rows = [np.flatnonzero(text == label) for label in labels]
    counts = [len(found) for found in rows]
    if sum(counts) < len(text) or np.ptp(counts) > max(1.0, _UNEQUAL * max(counts)):
        return None
    return labels, np.array([found[: min(counts)] for found in rows])
