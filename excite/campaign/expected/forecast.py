"""How many parameters will be certain enough after the motions at hand, and how much more motion the others take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.identification.judgement.poor import PATIENCE
from excite.reading.number import check_number
from excite.shown import span

# What is asked for unless somebody asks for something else: a value is known to a seventh of itself [percent].
TARGET_RSD = 15.0
# Below a millionth of a per cent rounding decides; a thousandfold deviation is no target [percent].
_TARGETS_RSD = (1e-6, 1e5)


def check_target(target_rsd: float) -> None:
    """Refuse what is no relative standard deviation to ask for; raises InputError."""
    check_number(target_rsd, "target_rsd", *_TARGETS_RSD, "percent")


@dataclass(frozen=True)
class Forecast:
    """What is to be expected of a target before anything is measured.

    Standard deviations fall with the square root of the amount of motion, so that ``(rsd / target)²`` times the
    motion at hand is needed where it is more of the same kind. Motion that aims at single joints takes less.

    Attributes:
        target_rsd: relative standard deviation to reach [percent].
        seconds: motion at hand [s].
        needed_s: motion with which each essential parameter reaches the target, by its name [s].
    """

    target_rsd: float
    seconds: float
    needed_s: Mapping[str, float]

    @classmethod
    def of(cls, rsd_percent: Mapping[str, float], target_rsd: float, seconds: float) -> Forecast:
        """The forecast of predicted relative standard deviations [percent], by essential parameter."""
        needed = {name: seconds * (rsd / target_rsd) ** 2 for name, rsd in rsd_percent.items()}
        return cls(target_rsd, seconds, needed)

    @classmethod
    def from_json(cls, entry: Mapping[str, Any] | None) -> Forecast | None:
        """The forecast of an entry in ``excite.plan/1``; None for none."""
        return (
            None if entry is None else cls(entry["target_rsd_percent"], entry["seconds"], entry["needed_s"])
        )

    @property
    def within(self) -> int:
        """Number of parameters that are expected to reach the target with the motion at hand."""
        return sum(needed <= self.seconds for needed in self.needed_s.values())

    def to_json(self) -> dict[str, Any]:
        """Its entry in ``excite.plan/1``."""
        return {
            "target_rsd_percent": self.target_rsd,
            "seconds": self.seconds,
            "within": self.within,
            "essential": len(self.needed_s),
            "needed_s": dict(self.needed_s),
        }

    def summary(self) -> str:
        """One line for a person."""
        total = len(self.needed_s)
        line = (
            f"to be expected of {self.seconds:.0f} s: {self.within} of {total} essential parameters within "
        )
        line += f"{self.target_rsd:g} %"
        later = np.array([needed for needed in self.needed_s.values() if needed > self.seconds])
        within_reach = later[later <= PATIENCE * self.seconds]
        if len(within_reach):
            least, most = f"{within_reach.min():.0f} s", f"{within_reach.max():.0f} s"
            line += f"; {len(within_reach)} more would take motion like this for "
            line += f"{span(least, most, ' to ')} in all"
        if len(later) > len(within_reach):
            line += f"; {len(later) - len(within_reach)} would take more than {PATIENCE:g} times as much"
        return line
