"""Arrays by name as streams: those of one length together, with the names of joints that lists beside them hold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.conversion.columns.words import read_clue
from excite.conversion.recording import Column, Stream
from excite.conversion.shapes.labels import in_one_order, with_labels, word_lists

# Texts of a row each are as many as a recording has rows, which are more than a robot has joints.
_MOST_LABELS = 100


def stream_of_arrays(name: str, arrays: Mapping[str, Any], time: Array | None = None) -> list[Stream]:
    """Arrays as streams: those of one length together, ``(n, k)`` taken apart into ``NAME[0] … NAME[k-1]``.

    Lists of ``k`` words name the columns of arrays that are ``k`` wide, a word for every row is a text of that row.
    Arrays of three axes or more are left out, but for those of one row a sample.
    """
    arrays = in_one_order(arrays)
    lengths: dict[int, list[Column]] = {}
    words: dict[int, dict[str, NDArray[np.object_]]] = {}
    for key, values in arrays.items():
        array = np.squeeze(np.asarray(values))
        if array.dtype.kind in "SUO" and array.ndim == 1 and len(array) > _MOST_LABELS:
            texts = np.char.decode(array, "utf-8", "replace") if array.dtype.kind == "S" else array
            words.setdefault(len(array), {})[key] = texts.astype(object)
        if array.dtype.kind == "b":
            array = array.astype(float)
        if array.dtype.kind not in "fiu" or array.ndim not in (1, 2) or not array.size:
            continue
        if array.ndim == 2 and array.shape[0] < array.shape[1]:
            array = array.T
        columns = (
            [(key, array)]
            if array.ndim == 1
            else [(f"{key}[{k}]", array[:, k]) for k in range(array.shape[1])]
        )
        found = lengths.setdefault(len(array), [])
        found += [Column(label, np.asarray(column, dtype=float)) for label, column in columns]
    names = word_lists(arrays)
    _with_one_row_less(lengths)
    return [
        with_labels(
            Stream(
                name,
                tuple(columns),
                time if time is not None and len(time) == n else None,
                words=words.get(n, {}),
            ),
            names,
        )
        for n, columns in lengths.items()
    ]


def _with_one_row_less(lengths: dict[int, list[Column]]) -> None:
    """Arrays of one row less stand with those that have it, the last row not known.

    Optimal control has a control between two states: xs of 101 rows, us of 100.
    """
    for n in sorted(lengths, reverse=True):
        fewer = lengths.get(n - 1)
        if fewer is None or n not in lengths or n <= _MOST_LABELS:
            continue
        if any(read_clue(column.name, ()).quantity == "time" for column in fewer):
            continue
        lengths[n] += [replace(column, values=np.append(column.values, np.nan)) for column in fewer]
        del lengths[n - 1]


def split_batches(arrays: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Arrays of each trial, where arrays of three axes hold trials, samples and joints; empty where there are none."""
    stacked = {key: np.asarray(values) for key, values in arrays.items() if np.ndim(values) == 3}
    stacked = {
        key: values for key, values in stacked.items() if values.dtype.kind == "f" and 1 not in values.shape
    }
    shapes = {values.shape[:2] for values in stacked.values()}
    if len(shapes) != 1:
        return {}
    ((count, rows),) = shapes
    # Images have their rows and columns behind the samples, of which there are more than of trials.
    if count > rows or any(len(values) == rows for key, values in arrays.items() if np.ndim(values) == 2):
        return {}
    return {
        f"trial_{k}": {
            key: np.asarray(values)[k] if np.shape(values)[:2] == (count, rows) else values
            for key, values in arrays.items()
        }
        for k in range(count)
    }


def longest_streams(streams: Iterable[Stream]) -> tuple[Stream, ...]:
    """Streams that may be signals: not those with a hundredth of the longest one's rows, which are constants."""
    kept = list(streams)
    most = max((stream.n_rows for stream in kept), default=0)
    return tuple(stream for stream in kept if stream.n_rows >= max(3, most // 100))
