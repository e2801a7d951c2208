"""``excite.export/1``: the files that were written for a controller."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from excite.documents.document import MOST_ENTRIES, Document, FilePath, Name


class Export(Document):
    """The files that were written for a controller."""

    schema_: Literal["excite.export/1"] = Field(alias="schema", description="version of this document")
    format: Name = Field(description="format of the files")
    files: Annotated[list[FilePath], Field(max_length=MOST_ENTRIES)] = Field(
        description="relative to --out, or to the working folder"
    )
