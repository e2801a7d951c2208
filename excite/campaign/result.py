"""What a campaign has found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from excite.campaign.expected.forecast import Forecast
from excite.campaign.targets import Miss
from excite.excitation.conditioning import Conditioning
from excite.identification.result import Identification
from excite.shown import Row, Tabled, count

SCHEMA = "excite.campaign/1"


@dataclass(frozen=True, eq=False)
class Iteration:
    """One turn of plan, run, identify.

    Attributes:
        n_motions: motions run in this iteration, those for validation included.
        seconds: motion that identification had after it, all iterations together [s].
        rsd_percent: by essential base parameter.
        missed: parameters that missed the target after it.
        forecast: what its plan said of the target beforehand; None where the sensors' noise is not stated.
    """

    n_motions: int
    seconds: float
    rsd_percent: dict[str, float]
    missed: tuple[Miss, ...]
    forecast: Forecast | None = None

    def to_json(self) -> dict[str, Any]:
        """The iteration's entry in ``excite.campaign/1``."""
        return {
            "n_motions": self.n_motions,
            "seconds": self.seconds,
            "rsd_percent": self.rsd_percent,
            "not_met": [miss.parameter for miss in self.missed],
            "helped": [miss.parameter for miss in self.missed if miss.reason.helped_by_motion],
            "forecast": None if self.forecast is None else self.forecast.to_json(),
            "reasons": {miss.parameter: miss.reason.value for miss in self.missed},
        }


@dataclass(frozen=True, eq=False, repr=False)
class Campaign(Tabled):
    """A campaign, finished or waiting for a recording.

    Attributes:
        robot: name of the robot.
        target_rsd: what was asked for [percent].
        iterations: in order.
        identification: from all logs so far; None before the first log.
        conditioning: of all chosen motions together.
        awaits: folder that a log has to be put into before ``--resume``; None when finished.
        expected: what the last plan said of the target; None where the sensors' noise is not stated.
        interrupted: whether the user broke off: the iterations are those that were complete.
    """

    robot: str
    target_rsd: float
    iterations: tuple[Iteration, ...]
    identification: Identification | None
    conditioning: Conditioning | None
    awaits: Path | None = None
    expected: Forecast | None = None
    interrupted: bool = False

    tables = ("targets", "iterations")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.shown.Tabled`: relative standard deviations by iteration, or the iterations."""
        if table == "targets":
            return [
                {
                    "iteration": number,
                    "parameter": name,
                    "rsd_percent": rsd,
                    "met": rsd <= self.target_rsd,
                }
                for number, item in enumerate(self.iterations, start=1)
                for name, rsd in item.rsd_percent.items()
            ]
        return [
            {
                "iteration": number,
                "n_motions": item.n_motions,
                "seconds": item.seconds,
                "n_missed": len(item.missed),
            }
            for number, item in enumerate(self.iterations, start=1)
        ]

    @property
    def missed(self) -> tuple[Miss, ...]:
        """Parameters that miss the target after the last iteration."""
        return self.iterations[-1].missed if self.iterations else ()

    @property
    def targets_met(self) -> bool:
        """Whether every essential parameter reached the target."""
        return self.awaits is None and not self.interrupted and bool(self.iterations) and not self.missed

    def to_json(self) -> dict[str, Any]:
        """The ``excite.campaign/1`` document."""
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "target_rsd_percent": self.target_rsd,
            "iterations": [iteration.to_json() for iteration in self.iterations],
            "targets_met": self.targets_met,
            "interrupted": self.interrupted,
            "awaits": None if self.awaits is None else str(self.awaits),
            "identification": None if self.identification is None else self.identification.to_json(),
        }

    def summary(self) -> str:
        """A few lines for a person."""
        lines = []
        for number, item in enumerate(self.iterations, start=1):
            if item.forecast is not None:
                lines.append(f"plan {number}, {item.forecast.summary()}")
            below = sum(rsd <= self.target_rsd for rsd in item.rsd_percent.values())
            lines.append(
                f"iteration {number}: {count(item.n_motions, 'motion')}, {item.seconds:.0f} s in all, "
                f"{below} of {len(item.rsd_percent)} essential parameters within {self.target_rsd:g} %"
            )
        if any(
            i.forecast is not None and len(i.forecast.needed_s) != len(i.rsd_percent) for i in self.iterations
        ):
            lines.append(
                "which parameters are essential the record decides; plans foresee them by the nominal model"
            )
        if self.identification is not None:
            lines += ["", self.identification.summary(), ""]
        if self.awaits is not None:
            if self.expected is not None:
                lines.append(f"plan {len(self.iterations) + 1}, {self.expected.summary()}")
            lines.append(f"record the motions and put the log into {self.awaits}, then go on with --resume")
        elif self.interrupted:
            lines.append("interrupted: go on with --resume")
        elif self.targets_met:
            lines.append("all targets met")
        else:
            lines.append(f"{count(len(self.missed), 'target')} not met:")
            lines += [f"  {miss}" for miss in self.missed]
            if not any(miss.reason.helped_by_motion for miss in self.missed):
                lines.append("more motion would meet none of them")
        return "\n".join(lines)
