"""``excite.campaign/1``: certainty iteration by iteration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Annotated, Literal

from pydantic import Field

from excite.documents import document
from excite.documents.identification import Identification
from excite.identification.judgement.forecast import Forecast
from excite.identification.judgement.judgement import said_rsd
from excite.results import ADDED, HIDDEN, Seconds, Stated, UnboundedPositive, stated, stated_later

# A figure has a column for each; three are usual.
_MOST_ITERATIONS = 100


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


class Campaign(document.Document):
    """A campaign, finished or waiting for a recording."""

    schema_: Literal["excite.campaign/1"] = Field(alias="schema", description="version of this document")
    robot: document.Name | None = Field(default=None, description="name of the robot")
    target_rsd_percent: document.Positive | None = Field(
        default=None, description="relative standard deviation that was asked for [percent]"
    )
    iterations: Annotated[tuple[Iteration, ...], document.AS_DOCUMENT, Field(max_length=_MOST_ITERATIONS)] = (
        Field(description="in their order")
    )
    targets_met: bool = Field(description="whether every parameter aimed at reached the target")
    minutes: document.Positive | None = Field(
        default=None, description="of motion in each iteration; null where nobody said [min]"
    )
    aims: Annotated[tuple[str, ...], document.AS_DOCUMENT] = Field(
        default=document.NONE,
        description="parameters that the first was expected to reach; empty where all essential ones are aimed at",
    )
    out_of_reach: Annotated[tuple[str, ...], document.AS_DOCUMENT] = Field(
        default=document.NONE, description="those that it was not"
    )
    interrupted: bool = Field(default=False, description="whether the user broke off after these iterations")
    awaits: document.FilePath | None = Field(
        default=None, description="folder that a log has to be put into; null where it is finished"
    )
    identification: Identification | None = Field(
        description="from all logs so far; null before the first one"
    )
