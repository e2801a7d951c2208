"""A finding, as it stands in every document that has any."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from excite.documents.document import MOST_ENTRIES, Block, Name, Text, Texts


class Finding(Block):
    """What a careful reader should know."""

    kind: Name = Field(description="a word that programs can test for")
    text: Text = Field(description="what was found, the likely cause, what to do")
    figures: Annotated[dict[Name, Any], Field(max_length=MOST_ENTRIES)] = Field(
        default={}, description="the numbers behind it by name [SI]"
    )
    places: Texts = Field(default=[], description="joints, links, channels or parameters concerned")
    severity: Literal["fatal", "spoils", "limits", "note"] = Field(
        default="note", description="fatal: nothing can be told; spoils results; limits them; or a note"
    )
    sure: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=1.0, description="how far it is to be believed"
    )
    repaired: bool = Field(default=False, description="whether what follows works with it mended")
    remedy: Text = Field(default="", description="what was done, or what is to be done")
    trials: Texts = Field(default=[], description="trials concerned; empty for all")
