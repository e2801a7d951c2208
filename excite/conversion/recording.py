"""A recording as its file has it: named columns on time bases of their own, before anybody says what they mean."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.errors import LogError


@dataclass(frozen=True, eq=False)
class Column:
    """One column.

    Attributes:
        name: as the file calls it.
        values: ``(n,)``, not a number where a row has none.
        channel: what it holds (``q``, ``tau`` …) where the format itself says so; empty where it has to be guessed.
        label: the joint or sensor that the format names beside it; empty for none.
        unit: as the format states it; empty for none.
    """

    name: str
    values: Array
    channel: str = ""
    label: str = ""
    unit: str = ""


@dataclass(frozen=True, eq=False)
class Stream:
    """Columns that were recorded together.

    Attributes:
        name: of the topic, table or group.
        columns: in the file's order.
        time: ``(n,)`` [s] where the format says when rows were recorded; None where a column may say it.
        late_by_name: whether ``time`` is when rows were written rather than measured.
    """

    name: str
    columns: tuple[Column, ...]
    time: Array | None = None
    late_by_name: bool = False

    @property
    def n_rows(self) -> int:
        """Rows of the stream."""
        return len(self.columns[0].values) if self.columns else 0


@dataclass(frozen=True, eq=False)
class Recording:
    """What was recorded without interruption.

    Attributes:
        source: the file.
        name: short name, used for the trial.
        streams: what it holds.
        said: numbers that hold for the whole of it, by name (``kp``, ``fps`` …).
        notes: what its reader found worth saying, a sentence each.
    """

    source: str
    name: str
    streams: tuple[Stream, ...]
    said: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def stream_of_arrays(name: str, arrays: Mapping[str, Any], time: Array | None = None) -> list[Stream]:
    """Arrays as streams: those of one length together, ``(n, k)`` taken apart into ``NAME[0] … NAME[k-1]``.

    What holds no numbers is left out; so are arrays of three axes or more, but for those of one row a sample.
    """
    lengths: dict[int, list[Column]] = {}
    for key, values in arrays.items():
        array = np.squeeze(np.asarray(values))
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
    return [
        Stream(name, tuple(columns), time if time is not None and len(time) == n else None)
        for n, columns in lengths.items()
    ]


def longest(streams: Iterable[Stream]) -> tuple[Stream, ...]:
    """Streams that may be signals: not those with a hundredth of the longest one's rows, which are constants."""
    kept = list(streams)
    most = max((stream.n_rows for stream in kept), default=0)
    return tuple(stream for stream in kept if stream.n_rows >= max(3, most // 100))


def merged_names(recording: Recording) -> Recording:
    """The recording with every column's name unique: that of its stream before it where two streams share one."""
    names = [column.name for stream in recording.streams for column in stream.columns]
    twice = {name for name in names if names.count(name) > 1} if len(set(names)) < len(names) else set()
    streams = []
    for stream in recording.streams:
        columns = tuple(
            replace(c, name=f"{stream.name}/{c.name}") if c.name in twice else c for c in stream.columns
        )
        streams.append(replace(stream, columns=columns))
    return replace(recording, streams=tuple(streams))


def nothing_there(path: object) -> LogError:
    """The error for a source that holds no numbers over time."""
    return LogError(
        "holds no columns of numbers", source=path, remedy="give a recording with one row a sample"
    )
