"""Rows of one topic as they come, in bounded memory however long the recording is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.conversion.recording import Column, Stream

# Numbers that are kept of one topic: 160 MB. An hour of a humanoid's 90 channels at 500 Hz has eight times as many,
# and its motion, below 10 Hz, loses nothing in means of eight rows.
_MOST_NUMBERS = 20_000_000
_FIRST_ROWS = 1024


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


class Gathered:
    """Collects rows whose columns may differ in order and number from message to message."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._fields: list[Field] = []
        self._index: dict[str, int] = {}
        self._known: dict[tuple[Field, ...], Array] = {}
        self._rows = np.empty((_FIRST_ROWS, 1))
        self._n = 0
        self._every = 1
        self._block: list[Array] = []

    def add(self, time: float, fields: Sequence[Field], values: Sequence[float]) -> None:
        """One message at a time [s]."""
        key = tuple(fields)
        if key not in self._known:
            self._learn(key)
        row = np.full(1 + len(self._fields), np.nan)
        row[0] = time
        row[self._known[key]] = values
        if self._every == 1:
            self._append(row)
            return
        self._block.append(row)
        if len(self._block) == self._every:
            width = len(row)
            rows = [r for r in self._block if len(r) == width]
            self._append(np.mean(rows, axis=0))
            self._block.clear()

    def stream(self, start: float) -> Stream | None:
        """What was gathered, times from ``start``; None for nothing."""
        if self._n == 0:
            return None
        rows = self._rows[: self._n]
        columns = tuple(
            Column(field.name, rows[:, 1 + k].copy(), field.channel, field.label)
            for k, field in enumerate(self._fields)
        )
        return Stream(self.name, columns, rows[:, 0] - start)

    def has_channel(self, channel: str) -> bool:
        """Whether a field of this channel was seen."""
        return any(field.channel == channel for field in self._fields)

    @property
    def note(self) -> str:
        """What was left out; empty for nothing."""
        return "" if self._every == 1 else f"{self.name}: rows are means of {self._every}, to fit into memory"

    @property
    def first_s(self) -> float:
        """Time of the first row; infinite for none."""
        return float(self._rows[0, 0]) if self._n else float("inf")

    def _learn(self, fields: tuple[Field, ...]) -> None:
        for field in fields:
            if field.name not in self._index:
                self._index[field.name] = len(self._fields)
                self._fields.append(field)
        width = 1 + len(self._fields)
        if width > self._rows.shape[1]:
            wider = np.full((len(self._rows), width), np.nan)
            wider[:, : self._rows.shape[1]] = self._rows
            self._rows = wider
        self._known[fields] = np.array([1 + self._index[field.name] for field in fields], dtype=int)

    def _append(self, row: Array) -> None:
        if self._n == len(self._rows):
            if self._rows.size >= _MOST_NUMBERS:
                half = self._n // 2 * 2
                self._rows[: half // 2] = 0.5 * (self._rows[0:half:2] + self._rows[1:half:2])
                self._n, self._every = half // 2, 2 * self._every
            else:
                more = np.full((2 * len(self._rows), self._rows.shape[1]), np.nan)
                more[: self._n] = self._rows
                self._rows = more
        self._rows[self._n, : len(row)] = row
        self._n += 1
