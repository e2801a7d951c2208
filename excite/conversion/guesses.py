"""What was guessed of a recording, with its reasons, and what has to be asked."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import yaml

from excite.arrays import Array
from excite.conversion.recording import Stream
from excite.errors import LogError


@cache
def messages() -> dict[str, dict[str, str]]:
    """The table of all that is asked and said, ``messages.yaml``: by key, its parts with places for words."""
    text = Path(__file__).with_name("messages.yaml").read_text(encoding="utf-8")
    found: dict[str, dict[str, str]] = yaml.safe_load(text)
    return found


def message(key: str, part: str, /, **words: object) -> str:
    """A part of a message with its words in their places."""
    return Template(messages()[key][part]).substitute({name: str(word) for name, word in words.items()})


@dataclass(frozen=True)
class Mapped:
    """One channel and where it comes from.

    Attributes:
        target: by the contract of log folders, such as ``q.elbow``.
        source: the column's name.
        factor: from the column's numbers to SI.
        because: why it is taken for that.
        stated: whether a map or the format said so, so that nothing was guessed.
        offset: added after scaling (SI).
        unit: what a name, the format or a map states of its unit; empty where it was guessed.
    """

    target: str
    source: str
    factor: float
    because: str
    stated: bool = False
    offset: float = 0.0
    unit: str = ""

    @property
    def channel(self) -> str:
        """``q`` of ``q.elbow``."""
        return self.target.partition(".")[0]

    @property
    def joint(self) -> str:
        """``elbow`` of ``q.elbow``."""
        return self.target.partition(".")[2]


@dataclass(frozen=True)
class Question:
    """Something that a recording does not tell.

    Attributes:
        key: of the table of messages.
        what: what is missing, in a few words.
        line: the line of ``map.yaml`` that would settle it.
        torques: by channel, columns that would be torques if their scale were known; empty for other questions.
        units: units of positions, by channel or joint, one of which it is; empty for other questions.
    """

    key: str
    what: str
    line: str
    torques: Mapping[str, str] = field(default_factory=dict)
    units: tuple[Mapping[str, str], ...] = ()

    def with_rate(self, rate: float, why: str) -> Question:
        """The question for the rate with a number in its line [Hz], and what tells it."""
        return replace(self, line=self.line.replace("NUMBER", f"{rate:g}") + why)


@dataclass
class Guesses:
    """What was understood so far.

    Attributes:
        mapped: channels.
        facts: what else was decided: name, value, reason.
        questions: what is missing.
        unused: columns that nothing was made of.
        lost: those of them that are of joints by their names: positions, velocities, measured torques or currents.
        rate_hz: rows a second of streams without a clock; None where nothing states it.
        stated_because: what says the units of positions that a map states.
    """

    mapped: list[Mapped] = field(default_factory=list)
    facts: list[tuple[str, str, str]] = field(default_factory=list)
    questions: list[Question] = field(default_factory=list)
    unused: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    rate_hz: float | None = None
    stated_because: str = "unit stated in the map"

    def of(self, channel: str) -> list[Mapped]:
        """Columns of one channel."""
        return [item for item in self.mapped if item.channel == channel]

    @property
    def channels(self) -> set[str]:
        """Channels of which there is a column."""
        return {item.channel for item in self.mapped}

    def times(self, stream: Stream) -> Array | None:
        """Times of a stream [s], by its clock or by the rate that its recording states; None where it has neither."""
        clock = {item.source: item.factor for item in self.mapped if item.target == "time"}
        for column in stream.columns:
            if column.name in clock:
                return np.asarray(column.values * clock[column.name])
        if stream.time is None and self.rate_hz:
            return np.arange(stream.n_rows) / self.rate_hz
        return stream.time

    def note(self, key: str, /, **words: object) -> None:
        """Add what was decided: a row of ``log.yaml``'s ``guessed``, once."""
        what, source, because = (message(key, part, **words) for part in ("what", "source", "because"))
        self.facts += [] if (what, source, because) in self.facts else [(what, source, because)]

    def ask(self, key: str, more: Mapping[str, Any] | None = None, /, **words: object) -> None:
        """Add a question of the table of messages, once; ``more``: its ``torques`` or ``units``."""
        question = Question(key, message(key, "what", **words), message(key, "line", **words), **(more or {}))
        self.questions += [] if question in self.questions else [question]

    def ask_of_all(self, key: str, name: str, /, **words: object) -> None:
        """Add a question that one line settles for all recordings or tables that it is asked of."""
        asked = next((question for question in self.questions if question.key == key), None)
        if asked is None:
            self.ask(key, name=name, have="has", **words)
            return
        first = re.split(" (?:has|have) ", asked.what, maxsplit=1)[0]
        names, _, count = first.partition(" and ")
        more = int(count.partition(" ")[0] or 0) + 1 if not count or count.endswith(" more") else 1
        what = message(key, "what", name=f"{names} and {more} more", have="have", **words)
        self.questions[self.questions.index(asked)] = replace(asked, what=what)

    def rows(self) -> list[tuple[str, str, str]]:
        """Channel, source and reason of everything that was guessed; columns of one pattern in one row."""
        grouped: dict[tuple[str, str, float], list[Mapped]] = {}
        for item in self.mapped:
            grouped.setdefault((item.channel, item.because, item.factor), []).append(item)
        found = []
        for (channel, because, factor), items in grouped.items():
            source = items[0].source if len(items) == 1 else f"{items[0].source} … {items[-1].source}"
            times = "" if factor == 1.0 else f" × {factor:.6g}"
            name = items[0].target if len(items) == 1 else f"{channel} ({len(items)})"
            found.append((name, source + times, because))
        return found + self.facts


class UnclearError(LogError):
    """A recording that leaves questions; all of them at once, each with the line that would settle it.

    Args:
        questions: the questions.
        source: the recording.
    """

    def __init__(self, questions: Sequence[Question], source: object):
        self.questions = tuple(questions)
        what = "; ".join(f"{question.what} (map.yaml: {question.line})" for question in questions)
        remedy = "write these lines into a map.yaml and run again with --map"
        super().__init__(what, source=source, remedy=remedy)
