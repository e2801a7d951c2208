"""``excite.rank/1``: condition numbers of motions, each alone and all together."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from excite.documents.document import MOST_ENTRIES, Block, Document, FilePath, Name, Seconds
from excite.documents.plan import Conditioning


class RankedMotion(Block):
    """One motion's own conditioning."""

    motion: FilePath = Field(description="its name")
    duration_s: Seconds = Field(description="duration [s]")
    conditioning: Conditioning = Field(description="of the motion alone")


class Rank(Document):
    """Motions from the best to the worst."""

    schema_: Literal["excite.rank/1"] = Field(alias="schema", description="version of this document")
    robot: Name = Field(description="name of the robot")
    motions: Annotated[list[RankedMotion], Field(max_length=MOST_ENTRIES)] = Field(description="best first")
    conditioning: Conditioning = Field(description="of all motions together")
