"""A mistake in how a log calls its channels: what undoing it would make of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from excite.doctor.channel_mapping import Reading
from excite.doctor.doubt import Doubt

THE_UNIT = "find the unit; results are in the log's unit"
"""What is asked for where a unit is none that is known."""


@dataclass(frozen=True, eq=False)
class Correction:
    """A log read otherwise.

    Attributes:
        reading: the channels with the mistake undone.
        text: what looks wrong, in words.
        places: joints or channels concerned.
        figures: numbers of the finding, SI.
        changes: how many things were changed at will: each has to bring its share.
        surprise: how unlikely the numbers are without the mistake [nat], where likely bodies could make them too;
            None where the fit decides.
        ask: what a person has to say, where nobody else can; the log is then left as it is. Empty where it is mended.
        as_logged: of a correction that asks, what takes it out of a reading again.
        along: places among them that tell nothing of it and go with the others.
        certain: whether the log is mended with exactly what was found; an estimate leaves a rest.
        mends: what was done, where more is to be said of it than that it was put right.
    """

    reading: Reading
    text: str
    places: tuple[str, ...]
    figures: Mapping[str, float] = field(default_factory=dict)
    changes: int = 1
    surprise: float | None = None
    ask: str = ""
    as_logged: Callable[[Reading], Reading] = lambda reading: reading
    along: tuple[str, ...] = ()
    certain: bool = True
    mends: str = ""


@dataclass(frozen=True)
class Mistake:
    """A way to call channels wrongly: a row of a table.

    Attributes:
        name: kind of its findings.
        corrections: of samples of the log and of the reading so far, other mistakes undone: readings in which it is
            undone, the plausible ones.
        leaves: what is known only about where it could not be undone exactly.
        of_posture: whether it is one of how joints or base were recorded, which those that were computed do not have.
        may_surprise: whether it has corrections that are believed though likely bodies explain the log as it is.
    """

    name: str
    corrections: Callable[[Any, Reading], Iterable[Correction]]
    leaves: frozenset[Doubt] = frozenset()
    of_posture: bool = False
    may_surprise: bool = False
