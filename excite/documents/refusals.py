"""``excite.refusals/1``: why a plan has no motion, what refuses its candidates."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from excite.documents.document import MOST_ENTRIES, Assumptions, Count, Document, FilePath, Name
from excite.documents.plan import Refused, Remedy


class Refusals(Document):
    """What refuses all candidates of a plan, and the change most likely to help."""

    schema_: Literal["excite.refusals/1"] = Field(alias="schema", description="version of this document")
    robot: Name = Field(description="name of the robot")
    robot_file: FilePath | None = Field(
        default=None, description="robot.yaml of a robot of one's own, relative to this document's folder"
    )
    generated: Count = Field(description="number of candidate motions, none of which is safe")
    refused: Annotated[list[Refused], Field(max_length=MOST_ENTRIES)] = Field(
        description="what refuses candidates, the commonest first"
    )
    remedy: Remedy | None = Field(
        default=None, description="the change most likely to help; null where none of those tried helps"
    )
    assumed: Assumptions = Field(default=[], description="what no file said of the robot")
