"""Messages of ROS and of Unitree, whichever library decodes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.conversion.recording import Column, Stream

# Rows of a recording's topics as they come, in bounded memory however long the recording is.

# Numbers that are kept of all topics together: 112 MB, of which a conversion takes five to six times as much with the
# doctor at its end (0.44 GB for 58 MB, 0.57 GB for 72 MB, 0.17 GB of them for libraries). An hour of a humanoid's 90
# channels at 500 Hz has twelve times as many, and its motion, below 10 Hz, loses nothing in means of sixteen rows.
_MOST_NUMBERS = 14_000_000
_FIRST_ROWS = 1024
_LAYOUTS = 1024
# A topic for which there is less room than for an eighth of what it has would be copied too often.
_LEAST_GROWTH = 8


@dataclass(frozen=True)
class Field:
    """One number of a message: its name, and what the message type says of it.

    Attributes:
        name: such as ``position.elbow``.
        channel: the log's channel, empty where the type does not say one.
        label: joint or axis.
    """

    name: str
    channel: str = ""
    label: str = ""


Row = tuple[Sequence[Field], list[float]]


class Room:
    """What the topics of a recording may keep together; the one that keeps most gives way."""

    def __init__(self, most: int = _MOST_NUMBERS) -> None:
        self._most = most
        self._topics: list[Gathered] = []

    def enter(self, topic: Gathered) -> None:
        """One more that keeps numbers."""
        self._topics.append(topic)

    @property
    def spare(self) -> int:
        """Numbers that still fit."""
        return self._most - sum(topic.size for topic in self._topics)

    def make(self, numbers: int) -> None:
        """See that so many more numbers fit, by means of rows where they do not."""
        while self.spare < numbers:
            largest = max(self._topics, key=lambda topic: topic.size)
            if not largest.halve():
                return


class Gathered:
    """Collects rows whose columns may differ in order and number from message to message."""

    def __init__(self, name: str, room: Room) -> None:
        self.name = name
        self._room = room
        self._fields: list[Field] = []
        self._index: dict[str, int] = {}
        self._known: dict[tuple[Field, ...], NDArray[np.int64]] = {}
        self._last: dict[int, tuple[tuple[Field, ...], NDArray[np.int64]]] = {}
        # A column a row of memory, so that nothing is copied to hand columns out.
        self._columns = np.empty((1, _FIRST_ROWS))
        self._n = 0
        self._every = 1
        self._block: list[Array] = []
        room.enter(self)

    def add(self, time: float, fields: Sequence[Field], values: Sequence[float]) -> None:
        """One message at a time [s]."""
        if self._n == self._columns.shape[1]:
            self._grow()
        places = self._places(fields)
        row = np.full(1 + len(self._fields), np.nan)
        row[0] = time
        row[places] = values
        if self._every == 1:
            self._append(row)
            return
        self._block.append(row)
        if len(self._block) >= self._every:
            width = len(row)
            rows = [r for r in self._block if len(r) == width]
            self._append(np.mean(rows, axis=0))
            self._block.clear()

    def stream(self, start: float) -> Stream | None:
        """What was gathered, times from ``start``; None for nothing."""
        if self._n == 0:
            return None
        columns = tuple(
            Column(field.name, self._columns[1 + k, : self._n], field.channel, field.label)
            for k, field in enumerate(self._fields)
        )
        return Stream(self.name, columns, self._columns[0, : self._n] - start)

    def has_channel(self, channel: str) -> bool:
        """Whether a field of this channel was seen."""
        return any(field.channel == channel for field in self._fields)

    @property
    def size(self) -> int:
        """Numbers that there is room for."""
        return int(self._columns.size)

    @property
    def note(self) -> str:
        """What was left out; empty for nothing."""
        return "" if self._every == 1 else f"{self.name}: rows are means of {self._every}, to fit into memory"

    @property
    def first_s(self) -> float:
        """Time of the first row; infinite for none."""
        return float(self._columns[0, 0]) if self._n else float("inf")

    def halve(self) -> bool:
        """Keep means of two rows in half the room; whether there was anything to halve."""
        if self._n < 2:
            return False
        kept = self._n // 2
        if self._n % 2:
            # The row without a partner stands for as many as it is the mean of.
            self._block[:0] = [self._columns[:, self._n - 1].copy()] * self._every
        for column in self._columns:
            column[:kept] = 0.5 * (column[0 : 2 * kept : 2] + column[1 : 2 * kept : 2])
        self._n, self._every = kept, 2 * self._every
        self._resize(max(kept, 1))
        return True

    def _places(self, fields: Sequence[Field]) -> NDArray[np.int64]:
        """Where a row has these fields. Decoders hand the same tuple over again and again, which need not be hashed."""
        known = self._last.get(id(fields))
        if known is not None:
            return known[1]
        key = tuple(fields)
        if key not in self._known:
            self._learn(key)
        if fields is key:
            if len(self._last) >= _LAYOUTS:
                self._last.clear()
            # With the tuple, so that no other one comes to its address.
            self._last[id(fields)] = (key, self._known[key])
        return self._known[key]

    def _learn(self, fields: tuple[Field, ...]) -> None:
        for field in fields:
            if field.name not in self._index:
                self._index[field.name] = len(self._fields)
                self._fields.append(field)
        width, (before, rows) = 1 + len(self._fields), self._columns.shape
        if width > before:
            wider = np.empty((width, rows))
            wider[:before, : self._n] = self._columns[:, : self._n]
            wider[before:, : self._n] = np.nan
            self._columns = wider
        self._known[fields] = np.array([1 + self._index[field.name] for field in fields], dtype=int)

    def _append(self, row: Array) -> None:
        self._columns[: len(row), self._n] = row
        self._columns[len(row) :, self._n] = np.nan
        self._n += 1

    def _grow(self) -> None:
        """Room for as many rows again, or for those that still fit."""
        self._room.make(max(1, self._n // _LEAST_GROWTH) * len(self._columns))
        fitting = self._room.spare // len(self._columns)
        self._resize(self._n + max(1, min(self._n, fitting)))

    def _resize(self, rows: int) -> None:
        other = np.empty((len(self._columns), rows))
        other[:, : self._n] = self._columns[:, : self._n]
        self._columns = other
