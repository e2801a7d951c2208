"""Documents of results other than plans, identifications and diagnoses."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from excite.documents.document import (
    MOST_ENTRIES,
    Block,
    Count,
    Document,
    FilePath,
    Findings,
    Maybe,
    Name,
    Names,
    Positive,
    Text,
    Texts,
)

# ``excite.doctor/1``: what is wrong with a log, worst first.


class Doctor(Document):
    """What was found in a log, and where the repaired one is."""

    schema_: Literal["excite.doctor/1"] = Field(alias="schema", description="version of this document")
    robot: Name = Field(description="name of the robot")
    log_file: FilePath | None = Field(
        default=None,
        description="the log, relative to this document's folder; null where it was made in memory",
    )
    robot_file: FilePath | None = Field(
        default=None, description="the nominal robot where another than the log's was given, likewise"
    )
    healthy: bool = Field(description="whether nothing was found that spoils results")
    findings: Findings = Field(description="worst first")
    repaired: FilePath | None = Field(default=None, description="folder of the repaired log")
    episodes: Annotated[list[dict[str, Any]], Field(max_length=MOST_ENTRIES)] = Field(
        default=[], description="of a data set: each episode with verdict, findings and measures, worst first"
    )


# ``excite.export/1``: the files that were written for a controller.


class Export(Document):
    """The files that were written for a controller."""

    schema_: Literal["excite.export/1"] = Field(alias="schema", description="version of this document")
    format: Name = Field(description="format of the files")
    files: Annotated[list[FilePath], Field(max_length=MOST_ENTRIES)] = Field(
        description="relative to --out, or to the working folder"
    )


# ``excite.model/1``: a robot that was written for a simulator.


class ParameterChange(Block):
    """A parameter before and after."""

    place: Name = Field(description="link or joint")
    parameter: Name = Field(description="its name")
    unit: Name = Field(description="its unit")
    before: Maybe = Field(description="of the nominal model [unit]")
    after: Maybe = Field(description="as it was found [unit]")
    change: Maybe = Field(description="after minus before [unit]")
    percent: Maybe = Field(description="the change, of what was before; null where that was zero")


class LostParameter(Block):
    """Something that was found and that the format has no place for."""

    parameter: Name = Field(description="its name")
    where: Name = Field(description="joint, link or robot")
    value: Maybe = Field(description="as it was found [SI]; null where it is no number")
    why: Text = Field(description="what the format lacks, and what to do")


class FollowedParameters(Block):
    """What became of the torques, read from the files, when each parameter was changed."""

    torque_error: Positive = Field(description="of the files, relative to the largest torque")
    felt: Count = Field(description="number of parameters that torques follow")
    unseen: Names = Field(description="parameters that no torque depends on")
    not_held: Names = Field(description="parameters that the format does not have")


class Model(Document):
    """A robot that was written for a simulator."""

    schema_: Literal["excite.model/1"] = Field(alias="schema", description="version of this document")
    format: Name = Field(description="format of the files")
    robot: Name = Field(description="name of the robot")
    files: Annotated[list[FilePath], Field(max_length=MOST_ENTRIES)] = Field(
        description="relative to this document's folder; the first is the one to open"
    )
    changes: Annotated[list[ParameterChange], Field(max_length=MOST_ENTRIES)] = Field(
        description="all parameters of bodies and joints"
    )
    lost: Annotated[list[LostParameter], Field(max_length=MOST_ENTRIES)] = Field(
        description="what was found and is not in the files"
    )
    notes: Texts = Field(description="what a user of the files should know")
    proof: FollowedParameters = Field(description="that the files are understood as they are meant")
