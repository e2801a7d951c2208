"""What all JSON documents have in common: how they are read and checked, and the kinds of values in them."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from excite.errors import InputError
from excite.formats.documents import check_content, read_json

# Products of three such numbers are still finite in double precision, so that no sum of squares, ratio or axis of a
# figure overflows; nothing in SI units comes near it.
LARGEST = 1e100
# A year of motion, in seconds: no experiment is longer.
_LONGEST_S = 3.2e7
# Longest name that file systems allow; base parameters' names are below 60 characters.
_NAME_LENGTH = 255
# The longest sentence or expression known here, a base parameter of a humanoid, has 3000 characters.
_TEXT_LENGTH = 100_000
# Ten times what a plan of 2000 motions, or a humanoid's 400 base parameters with their lists, comes to.
MOST_ENTRIES = 20_000
# Joints, sensors' axes, links: the largest robot known here has 60 of each. Figures have a row or a panel for each.
MOST_CHANNELS = 250


def _check_inside(path: str) -> str:
    parts = PurePosixPath(path)
    if parts.is_absolute() or ".." in parts.parts or not parts.parts:
        raise ValueError("Path should stay inside the folder: relative, without '..'")
    return path


Number = Annotated[float, Field(strict=True, ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
Maybe = Number | None
"""A number, null where it is not known or not finite."""
Positive = Annotated[float, Field(strict=True, ge=0.0, le=LARGEST, allow_inf_nan=False)]
MaybePositive = Positive | None
Seconds = Annotated[float, Field(strict=True, ge=0.0, le=_LONGEST_S, allow_inf_nan=False)]
# Counts stay integers in double precision.
Count = Annotated[int, Field(strict=True, ge=0, le=2**53)]
Name = Annotated[str, Field(strict=True, max_length=_NAME_LENGTH, pattern=r"^[^\x00-\x1f\x7f]*$")]
Text = Annotated[str, Field(strict=True, max_length=_TEXT_LENGTH, pattern=r"^[^\x00-\x08\x0b-\x1f\x7f]*$")]
# Longest path that Linux takes.
FilePath = Annotated[str, Field(strict=True, max_length=4095, pattern=r"^[^\x00-\x1f\x7f]+$")]
InnerPath = Annotated[FilePath, AfterValidator(_check_inside)]
"""Path of a file inside the document's folder."""
Interval = Annotated[list[Maybe], Field(min_length=2, max_length=2)]
Vector3 = Annotated[list[Maybe], Field(min_length=3, max_length=3)]
Vector6 = Annotated[list[Maybe], Field(min_length=6, max_length=6)]
Texts = Annotated[list[Text], Field(max_length=MOST_ENTRIES)]
Names = Annotated[list[Name], Field(max_length=MOST_ENTRIES)]


class Block(BaseModel):
    """An object inside a document; fields that it does not name may be there and are not looked at."""

    # Validators are built when a document is first read: all take 0.1 s, and a command reads one or two.
    model_config = ConfigDict(
        extra="ignore", frozen=True, populate_by_name=True, strict=True, defer_build=True
    )


class AssumedValue(Block):
    """Something that no file said of a robot and that was assumed."""

    what: Text = Field(description="what was not said")
    value: Text = Field(description="what was taken for it")
    consequence: Text = Field(description="what follows from it")


Assumptions = Annotated[
    list[AssumedValue], Field(max_length=MOST_ENTRIES, description="what no file said of the robot")
]

AsFarAs = Annotated[
    Texts, Field(description="what has to hold of shapes that are not known, for what is safe to be so")
]


class Made(Block):
    """How a document came to be."""

    command: Text = Field(
        description="as it was typed, less where results go and how many processes make them"
    )
    version: Name = Field(description="of excite")
    seed: Count = Field(description="of all random numbers")


class Document(Block):
    """A whole document; its field ``schema`` says which, and of what version."""

    made: Made | None = Field(default=None, description="the command that wrote it; null where none did")

    def content(self) -> dict[str, Any]:
        """The document as plain objects, fields that the file left out with their defaults."""
        return self.model_dump(by_alias=True)

    def stated(self) -> dict[str, Any]:
        """The document as plain objects, only what the file states."""
        return self.model_dump(by_alias=True, exclude_unset=True)


_Kind = TypeVar("_Kind", bound=Document)


def read_document(
    path: str | Path,
    kind: type[_Kind],
    *,
    remedy: str = "write it again",
    error: type[InputError] = InputError,
) -> _Kind:
    """Read a JSON file and check every field of it.

    Args:
        path: of the file.
        kind: what it has to be.
        remedy: what to do where it is not.
        error: class of the errors.

    Raises:
        InputError: of the class ``error``: the file cannot be read, is no JSON object, is of another schema, or a
            field in it is missing or is not what it has to be.
    """
    content = read_json(path, schema=schema_of(kind), remedy=remedy, error=error)
    return check_content(kind, content, Path(path), remedy=remedy, error=error)


def schema_of(kind: type[Document]) -> str:
    """What a document's field ``schema`` says, such as ``excite.plan/1``."""
    (stated,) = kind.model_fields["schema_"].annotation.__args__  # type: ignore[union-attr]
    return str(stated)


# A finding, as it stands in every document that has any.


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
