"""One trial as it was measured, and as the model tells it before and after the accepted effects."""

from __future__ import annotations

from dataclasses import dataclass

from excite.arrays import Array


@dataclass(frozen=True, eq=False)
class Curves:
    """A trial of a record.

    Attributes:
        trial: its name.
        validation: whether nothing was fitted on it.
        channels: names of the channels.
        units: unit of each.
        time: ``(n,)`` [s].
        measured: ``(n, n_channels)``, filtered as for the comparison.
        before: of the model alone, ``(n, n_channels)``.
        after: with the effects, ``(n, n_channels)``.
    """

    trial: str
    validation: bool
    channels: tuple[str, ...]
    units: tuple[str, ...]
    time: Array
    measured: Array
    before: Array
    after: Array
