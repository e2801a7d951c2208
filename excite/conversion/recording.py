"""A recording as its file has it: named columns on time bases of their own, before anybody says what they mean."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import NothingThereError

# How recordings call their rate and their step, letters only.
_RATES = frozenset(
    "fps fs rate ratehz hz frequency freq samplingrate samplerate samplingfrequency samplefrequency frequencyhz "
    "samplingratehz sampleratehz fshz".split()
)
_RATE_OF = re.compile(
    r"(action|control|ctrl|policy|log|logging|record|recording|data|state|loop|update)s?(hz|rate|freq|frequency)"
)
_STEPS = frozenset(
    "dt ts step timestep sampletime samplingtime deltat period tsample dts sampleperiod dtms tsms stepdt controldt "
    "ctrldt policydt envdt logdt".split()
)


@dataclass(frozen=True, eq=False)
class Column:
    """One column.

    Attributes:
        name: as the file calls it.
        values: ``(n,)``, not a number where a row has none.
        channel: what it holds (``q``, ``tau`` …) where the format itself says so; empty where it has to be guessed.
        label: the joint or sensor that the format, or a list of names in the file, names beside it; empty for none.
        unit: as the format states it; empty for none.
        spelt: its name with a number for a letter that counts; empty where the name has none.
    """

    name: str
    values: Array
    channel: str = ""
    label: str = ""
    unit: str = ""
    spelt: str = ""

    @property
    def said_as(self) -> str:
        """The name that is read."""
        return self.spelt or self.name


@dataclass(frozen=True, eq=False)
class Stream:
    """Columns that were recorded together.

    Attributes:
        name: of the topic, table or group.
        columns: in the file's order.
        time: ``(n,)`` [s] where the format says when rows were recorded; None where a column may say it.
        late_by_name: whether ``time`` is when rows were written rather than measured.
        words: ``(n,)`` texts of columns that hold no numbers, by their names; those that a table has.
        nameless: whether the file names no columns.
    """

    name: str
    columns: tuple[Column, ...]
    time: Array | None = None
    late_by_name: bool = False
    words: Mapping[str, NDArray[np.object_]] = field(default_factory=dict)
    nameless: bool = False

    @property
    def n_rows(self) -> int:
        """Rows of the stream."""
        return len(self.columns[0].values) if self.columns else 0

    def rows(self, chosen: slice | NDArray[np.bool_] | NDArray[np.int64]) -> Stream:
        """Some of the rows, or all in another order: of numbers, texts and times alike."""
        return replace(
            self,
            columns=tuple(replace(column, values=column.values[chosen]) for column in self.columns),
            words={name: cells[chosen] for name, cells in self.words.items()},
            time=None if self.time is None else self.time[chosen],
        )


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


def stated_rate(said: Mapping[str, Any]) -> float | None:
    """Rows a second [Hz] that a recording states as a rate or as the time between rows; None for none."""
    for name, value in said.items():
        word = re.sub(r"[^a-z]", "", name.rpartition("/")[2].lower())
        number = value if isinstance(value, int | float) and not isinstance(value, bool) else 0.0
        if not np.isfinite(number) or number <= 0.0:
            continue
        if (word in _RATES or _RATE_OF.fullmatch(word)) and number >= 1.0:
            return float(number)
        if word in _STEPS:
            # Nobody records a row a second or slower: such steps are in milliseconds.
            return 1.0 / number if number < 1.0 else 1e3 / number
    return None


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


def nothing_there(path: object) -> NothingThereError:
    """The error for a source that holds no numbers over time."""
    return NothingThereError(
        "holds no columns of numbers", source=path, remedy="give a recording with one row a sample"
    )
