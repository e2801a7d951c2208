"""``excite.campaign/1``: certainty iteration by iteration."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from excite.documents.document import (
    MOST_ENTRIES,
    Block,
    Count,
    Document,
    FilePath,
    MaybePositive,
    Name,
    Positive,
    Seconds,
    Text,
    Texts,
)
from excite.documents.identification import Identification
from excite.documents.plan import Forecast

# A figure has a column for each; three are usual.
_MOST_ITERATIONS = 100


class Iteration(Block):
    """One turn of plan, run, identify."""

    n_motions: Count = Field(description="motions that were run")
    seconds: Seconds | None = Field(default=None, description="motion to identify from, so far [s]")
    rsd_percent: Annotated[dict[Text, MaybePositive], Field(max_length=MOST_ENTRIES)] = Field(
        description="relative standard deviation by base parameter [percent]; null where it is infinite"
    )
    not_met: Texts = Field(description="parameters that missed the target")
    helped: Texts | None = Field(
        default=None, description="those of them that more motion may help; null where nobody says"
    )
    forecast: Forecast | None = Field(
        default=None,
        description="what its plan said of the target; null where the sensors' noise is not stated",
    )
    reasons: Annotated[dict[Text, Text], Field(max_length=MOST_ENTRIES)] = Field(
        default={}, description="why, by parameter"
    )


class Campaign(Document):
    """A campaign, finished or waiting for a recording."""

    schema_: Literal["excite.campaign/1"] = Field(alias="schema", description="version of this document")
    robot: Name | None = Field(default=None, description="name of the robot")
    target_rsd_percent: Positive | None = Field(
        default=None, description="relative standard deviation that was asked for [percent]"
    )
    iterations: Annotated[list[Iteration], Field(max_length=_MOST_ITERATIONS)] = Field(
        description="in their order"
    )
    targets_met: bool = Field(description="whether every essential parameter reached the target")
    interrupted: bool = Field(default=False, description="whether the user broke off after these iterations")
    awaits: FilePath | None = Field(
        default=None, description="folder that a log has to be put into; null where it is finished"
    )
    identification: Identification | None = Field(
        description="from all logs so far; null before the first one"
    )
