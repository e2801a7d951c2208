"""``excite.campaign/1``: certainty iteration by iteration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Annotated

from excite.display import Row, Tabled, count
from excite.excitation.conditioning import Conditioning
from excite.identification.judgement import Forecast, said_rsd
from excite.identification.result import Identification
from excite.results import (
    ADDED,
    FEW,
    HIDDEN,
    FilePath,
    Name,
    Positive,
    Seconds,
    Stated,
    UnboundedPositive,
    named,
    stated,
    stated_later,
    stated_with,
)


class Reason(Enum):
    """Why a parameter misses its target; the value is what a person is told."""

    MORE_MOTION = "more motion of its joint would bring it there"
    NOISE = "too small against the sensors' noise: no reasonable amount of motion would bring it there"
    STALLED = "hardly fell with the motion added so far: no reasonable amount of more would bring it there"
    NOT_EXCITED = "the motions do not excite it"

    @property
    def helped_by_motion(self) -> bool:
        """Whether more motion may bring a parameter to its target."""
        return self in {Reason.MORE_MOTION, Reason.NOT_EXCITED}


@dataclass(frozen=True)
class Miss:
    """A base parameter that misses the target.

    Attributes:
        parameter: name of its first standard parameter.
        rsd_percent: relative standard deviation [percent]; None where the data say nothing of it.
        reason: why.
        joints: joints whose motion would help.
    """

    parameter: str
    rsd_percent: float | None
    reason: Reason
    joints: tuple[str, ...]

    def __str__(self) -> str:
        rsd = "" if self.rsd_percent is None else f" ({said_rsd(self.rsd_percent)})"
        return f"{self.parameter}{rsd}: {self.reason.value}"


@dataclass(frozen=True, eq=False)
class Iteration(Stated):
    """One turn of plan, run, identify.

    Attributes:
        n_motions: motions run in this iteration, those for validation included.
        seconds: motion that identification had after it, all iterations together [s].
        rsd_percent: by base parameter that is aimed at, which are all essential ones where no minutes say.
        missed: parameters that missed the target after it.
        forecast: what its plan said of the target beforehand; None where the sensors' noise is not stated.
    """

    n_motions: int
    seconds: Seconds = field(metadata=ADDED)
    rsd_percent: Mapping[str, UnboundedPositive]
    missed: tuple[Miss, ...] = field(metadata=HIDDEN)
    forecast: Forecast | None = None

    @property
    @stated
    def not_met(self) -> tuple[str, ...]:
        """Parameters that missed the target."""
        return tuple(miss.parameter for miss in self.missed)

    @property
    @stated_later
    def helped(self) -> tuple[str, ...]:
        """Those of them that more motion may help."""
        return tuple(miss.parameter for miss in self.missed if miss.reason.helped_by_motion)

    @property
    @stated_later
    def reasons(self) -> Mapping[str, str]:
        """Why each of them missed it."""
        return {miss.parameter: miss.reason.value for miss in self.missed}


@dataclass(frozen=True, eq=False, repr=False)
class Campaign(Tabled, Stated):
    """A campaign, finished or waiting for a recording.

    Attributes:
        robot: name of the robot.
        target_rsd: relative standard deviation that was asked for [percent].
        iterations: in their order.
        identification: from all logs so far; None before the first log.
        conditioning: of all chosen motions together.
        awaits: folder that a log has to be put into before ``--resume``; None when finished.
        expected: what the last plan said of the target; None where the sensors' noise is not stated.
        interrupted: whether the user broke off after these iterations, which were complete.
        minutes: of motion in each iteration; null where nobody said [min].
        aims: parameters that the first plan for minutes expected to reach; empty where all essential ones are aimed at.
        out_of_reach: those that it did not.
    """

    SCHEMA = "excite.campaign/1"

    robot: Name = field(metadata=ADDED)
    target_rsd: Positive = field(metadata=named("target_rsd_percent") | ADDED)
    iterations: Annotated[tuple[Iteration, ...], FEW]
    identification: Identification | None
    conditioning: Conditioning | None = field(metadata=HIDDEN)
    awaits: Path | None = field(default=None, metadata=HIDDEN)
    expected: Forecast | None = field(default=None, metadata=HIDDEN)
    interrupted: bool = False
    minutes: Positive | None = None
    aims: tuple[str, ...] = ()
    out_of_reach: tuple[str, ...] = ()

    @property
    @stated_with(stated="awaits", added=None)
    def awaited_folder(self) -> FilePath | None:
        """Folder that a log has to be put into; null where it is finished."""
        return None if self.awaits is None else str(self.awaits)

    tables = ("targets", "iterations")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.display.Tabled`: relative standard deviations by iteration, or the iterations."""
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
    @stated
    def targets_met(self) -> bool:
        """Whether every parameter aimed at reached the target."""
        return self.awaits is None and not self.interrupted and bool(self.iterations) and not self.missed

    def _aims_in_words(self) -> list[str]:
        if not self.aims:
            return []
        far = f"; out of reach: {', '.join(self.out_of_reach)}" if self.out_of_reach else ""
        return [f"{self.minutes:g} min an iteration: {count(len(self.aims), 'parameter')} aimed at{far}"]

    def summary(self) -> str:
        """A few lines for a person."""
        lines = self._aims_in_words()
        kind = "parameters aimed at" if self.aims else "essential parameters"
        for number, item in enumerate(self.iterations, start=1):
            if item.forecast is not None:
                lines.append(f"plan {number}, {item.forecast.summary()}")
            below = sum(rsd <= self.target_rsd for rsd in item.rsd_percent.values())
            lines.append(
                f"iteration {number}: {count(item.n_motions, 'motion')}, {item.seconds:.0f} s in all, "
                f"{below} of {len(item.rsd_percent)} {kind} within {self.target_rsd:g} %"
            )
        if not self.aims and any(
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
