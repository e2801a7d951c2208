"""A mistake in how a log calls its channels: what undoing it would make of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.doctor.channel_mapping import Reading
from excite.doctor.doubt import Doubt
from excite.doctor.inertial_prior import Judgement


class Samples(Protocol):
    """Samples of a log that say how well a reading of its channels agrees with the nominal model."""

    @property
    def joints(self) -> tuple[str, ...]:
        """The log's joints."""

    @property
    def measured_name(self) -> str:
        """What was measured, in a word."""

    @property
    def channels(self) -> tuple[str, ...]:
        """What is predicted: joints with a torque, or components of the wrench on the base."""

    @property
    def first(self) -> NDArray[np.int64]:
        """Where a sample's trial begins among all that was logged, ``(n,)``; ``last``: where it ends."""

    @property
    def last(self) -> NDArray[np.int64]:
        """See ``first``."""

    @property
    def rate_hz(self) -> float:
        """Rate of what was logged [Hz]."""

    def slides(self, joint: int) -> bool:
        """Whether a joint, by its index among ``joints``, slides instead of turning."""

    def tells(self, reading: Reading) -> NDArray[np.bool_]:
        """Which channels the model's bodies make a good share of, ``(n_channels,)``; the rest is friction."""

    def left(self, reading: Reading) -> Array:
        """Half the logarithm of the share of each channel's power that nothing explains, ``(n_channels,)``."""

    def by_zero(self, reading: Reading, joint: int) -> Callable[[Array], Array]:
        """What is left where a joint's zero is moved, as a function of angles ``(k,)`` [rad]: ``(k, n_channels)``."""

    def by_gravity(self, reading: Reading) -> Callable[[Array], Array]:
        """What is left, as a function of gravities ``(k, 3)`` [m/s²]: ``(k, n_channels)``."""

    def judged(self, reading: Reading, counts: Array | None = None) -> Judgement:
        """The same beside the likeliest bodies, by so many effective samples a channel; slower."""


S = TypeVar("S", bound=Samples, contravariant=True)


def _untouched(reading: Reading) -> Reading:
    """The reading as it is."""
    return reading


# What is asked for where a unit is none that is known.
THE_UNIT = "find the unit; what follows is in the log's"


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
    as_logged: Callable[[Reading], Reading] = _untouched
    along: tuple[str, ...] = ()
    certain: bool = True
    mends: str = ""


@dataclass(frozen=True)
class Mistake(Generic[S]):
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
    corrections: Callable[[S, Reading], Iterable[Correction]]
    leaves: frozenset[Doubt] = frozenset()
    of_posture: bool = False
    may_surprise: bool = False
