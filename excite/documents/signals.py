"""``excite.signals/1``: what each step of the signal processing did to one channel."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from excite.documents.document import Block, Document, Maybe, Name, Number, Text

# A figure has a panel a step; the processing has nine.
_MOST_STEPS = 20
# Curves are written thinned out to 800 points.
_MOST_POINTS = 100_000


class Points(Block):
    """A curve."""

    x: Annotated[list[Number], Field(max_length=_MOST_POINTS)] = Field(description="in the unit of the axis")
    y: Annotated[list[Maybe], Field(max_length=_MOST_POINTS)] = Field(
        description="in the unit of the quantity; null where there is nothing"
    )

    @model_validator(mode="after")
    def _same_length(self) -> Points:
        if len(self.x) != len(self.y):
            raise ValueError(f"x has {len(self.x)} values, y has {len(self.y)}")
        return self


class SignalStep(Block):
    """One step: a signal before and after it."""

    name: Name = Field(description="the step")
    effect: Text = Field(description="what it did, in one sentence")
    quantity: Name = Field(description="what is shown, with its unit")
    axis: Name = Field(description="what it is shown over, with its unit")
    before: Points = Field(description="the signal before the step")
    after: Points = Field(description="the signal after it")
    dots: bool = Field(default=False, description="whether samples are shown one by one")


class Signals(Document):
    """The steps that one trial's channel went through."""

    schema_: Literal["excite.signals/1"] = Field(alias="schema", description="version of this document")
    trial: Name = Field(description="name of the trial")
    channel: Name = Field(description="joint or component of the wrench that is shown")
    steps: Annotated[list[SignalStep], Field(min_length=1, max_length=_MOST_STEPS)] = Field(
        description="in their order"
    )
