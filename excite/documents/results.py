"""Documents of results other than plans, identifications and diagnoses."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from excite.documents.document import (
    MOST_ENTRIES,
    Document,
    FilePath,
    Findings,
    Name,
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
