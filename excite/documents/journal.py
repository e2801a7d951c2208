"""``excite.journal/1``: the robot and the settings that a campaign was begun with."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from excite.documents.document import Block, Count, Document, Name, Positive


class Settings(Block):
    """What a campaign was asked for."""

    n_candidates: Count = Field(description="candidate motions in the first iteration")
    target_rsd: Positive = Field(description="relative standard deviation to reach [percent]")
    max_iterations: Count = Field(description="iterations at most")
    method: Name = Field(description="estimator")
    seed: int = Field(description="of all random numbers")
    on_robot: bool = Field(description="whether it waits for recordings of a real robot")


class Journal(Document):
    """The robot and the settings that a campaign was begun with."""

    schema_: Literal["excite.journal/1"] = Field(alias="schema", description="version of this document")
    robot_hash: Name = Field(description="hash of the robot's files")
    settings: Settings = Field(description="what the campaign was asked for")
