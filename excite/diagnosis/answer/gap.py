"""The gap between record and model: how large it is, what closes, and where it lies."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class ChannelGap:
    """Gap of one channel: RMS over the validation trials of measured minus predicted [the channel's unit].

    Attributes:
        before: with the baseline alone.
        after: with the accepted effects.
        noise_floor: what no model can go below.
        unit: of the three.
    """

    before: float
    after: float
    noise_floor: float
    unit: str = "N·m"


@dataclass(frozen=True)
class Gap:
    """The gap over all channels: root mean square over them, each divided by its standard deviation.

    Attributes:
        before: with the baseline alone.
        after: with the accepted effects.
        noise_floor: what no model can go below.
        share_closed: ``1 − (after² − floor²)/(before² − floor²)``; 0 where there was nothing to close.
        per_channel: by channel, in its own unit.
        interval: 90 % interval of what the effects, sized as they are, close on motions like the record's, their
            noise known; None where it was not computed or the record does not tell.
    """

    before: float
    after: float
    noise_floor: float
    share_closed: float
    per_channel: dict[str, ChannelGap]
    interval: tuple[float, float] | None = None

    @property
    def of_positions(self) -> bool:
        """Whether it is a gap of positions, in roll-outs, as that of a log without torques is."""
        return of_positions(item.unit for item in self.per_channel.values())

    def to_json(self) -> dict[str, Any]:
        """The gap as it stands in the document."""
        return {
            "before": self.before,
            "after": self.after,
            "noise_floor": self.noise_floor,
            "share_closed": self.share_closed,
            "share_closed_90": None if self.interval is None else list(self.interval),
            "per_channel": {
                name: {
                    "before": item.before,
                    "after": item.after,
                    "noise_floor": item.noise_floor,
                    "unit": item.unit,
                }
                for name, item in self.per_channel.items()
            },
        }


@dataclass(frozen=True)
class Where:
    """One line of the map of where the gap lies.

    Attributes:
        channel: joint, or wrench component.
        share: its share of the gap's power above the noise floor, over all channels, 0…1; of a joint its weight in
            the budget.
        depends_on: what its residual follows most: velocity, position, load, acceleration, time, … or none.
        band_hz: frequencies that hold the middle 80 % of its residual's power [Hz].
        dependence: share of the residual's power that each thing explains, by name, 0…1.
    """

    channel: str
    share: float
    depends_on: str
    band_hz: tuple[float, float]
    dependence: dict[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """The line as it stands in the document."""
        return {
            "channel": self.channel,
            "share": self.share,
            "depends_on": self.depends_on,
            "band_hz": list(self.band_hz),
            "dependence": dict(self.dependence),
        }


def of_positions(units: Iterable[str]) -> bool:
    """Whether a gap whose channels have these units is one of positions."""
    found = set(units)
    return bool(found) and found <= {"rad", "m"}


def closed_in_words(positions: bool) -> str:
    """What is meant by what each effect of a list closes.

    Args:
        positions: whether the gap is one of positions.
    """
    of = "the torques that the servo asks for, not of the positions" if positions else "the whole"
    return (
        f"closed: share of the gap of {of}, above the noise, on the trials that judge; an accepted effect "
        "together with those before it, every other one alone"
    )


def share_closed(before: float, after: float, floor: float) -> float:
    """``1 − (after² − floor²)/(before² − floor²)``, 0 where nothing stands above the floor."""
    open_power = before**2 - floor**2
    return 0.0 if open_power <= 0.0 else 1.0 - (after**2 - floor**2) / open_power
