"""What all JSON documents have in common: how they are read and checked, and the kinds of values in them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial, reduce
from operator import or_
from pathlib import Path, PurePosixPath
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, cast, get_args, get_origin

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, create_model, model_validator

from excite.formats.documents import check_content, read_json
from excite.results import FEW, Stated, sentence_of, stated_fields

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


class Block(BaseModel):
    """An object inside a document; fields that it does not name may be there and are not looked at."""

    # Validators are built when a document is first read: all take 0.1 s, and a command reads one or two.
    model_config = ConfigDict(
        extra="ignore", frozen=True, populate_by_name=True, strict=True, defer_build=True
    )


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


_Kind = TypeVar("_Kind", bound=Document | Stated)


def read_document(
    path: str | Path,
    kind: type[_Kind],
    *,
    remedy: str = "write it again",
) -> _Kind:
    """Read a JSON file and check every field of it.

    Args:
        path: of the file.
        kind: what it has to be: a model, or a result whose fields the document's are.
        remedy: what to do where it is not.

    Raises:
        InputError: the file cannot be read, is no JSON object, is of another schema, or a
            field in it is missing or is not what it has to be.
    """
    if issubclass(kind, Stated):
        found = read_document(path, model_of(kind), remedy=remedy)
        return kind.from_json(found.content())
    content = read_json(path, schema=schema_of(kind), remedy=remedy)
    return check_content(kind, content, Path(path), remedy=remedy)


def schema_of(kind: type[Document]) -> str:
    """What a document's field ``schema`` says, such as ``excite.plan/1``."""
    (stated,) = kind.model_fields["schema_"].annotation.__args__  # type: ignore[union-attr]
    return str(stated)


# Documents of results whose fields stand on their own dataclass.

# What a file may hold of each kind of value, by the word or the type that says it.
_KINDS: dict[Any, Any] = {
    "name": Name,
    "path": FilePath,
    "inner path": InnerPath,
    "positive": Positive,
    "seconds": Seconds,
    "maybe": Maybe,
    "maybe positive": MaybePositive,
    float: Number,
    int: Count,
    str: Text,
}


# What bounds lists and tables further.
_BOUNDS: dict[Any, Any] = {FEW: Field(max_length=MOST_CHANNELS)}


def _build_model(kind: type[Stated]) -> type[Document]:
    """What a file has to hold to be the document of a result, with every field's meaning.

    Args:
        kind: its dataclass.
    """
    fields: dict[str, Any] = {}
    for one in stated_fields(kind):
        content = _content_kind(one.kind)
        default = {} if one.required else {"default": one.default}
        if one.added:
            content = content | None if one.default is None else _without_null(content)
        fields[one.name] = (content, Field(description=one.meaning, **default))
    if kind.SCHEMA:
        stated = Field(alias="schema", description="version of this document")
        fields = {"schema_": (Literal[kind.SCHEMA], stated), **fields}
    base: Any = Document if kind.SCHEMA else Block
    checks: dict[str, Any] = {}
    if kind.contradiction is not Stated.contradiction:
        checks = {"agrees": model_validator(mode="after")(partial(_check_agreement, kind.contradiction))}
    return cast(
        type[Document],
        create_model(
            kind.__name__, __base__=base, __doc__=sentence_of(kind), __validators__=checks, **fields
        ),
    )


def _without_null(content: Any) -> Any:
    """The same content, which may not be null."""
    if get_origin(content) not in (Union, UnionType):
        return content
    return reduce(or_, (part for part in get_args(content) if part is not NoneType))


def _check_agreement(contradiction: Callable[[Any], str], found: Block) -> Block:
    if said := contradiction(found):
        raise ValueError(said)
    return found


model_of: Callable[[type[Stated]], type[Document]] = cast(Any, cache)(_build_model)


def _content_kind(kind: Any) -> Any:
    """What a file may hold of a field of that type."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        words = [word for word in parts[1:] if word in _KINDS]
        more = [_BOUNDS.get(word, word) for word in parts[1:]]
        return _KINDS[words[0]] if words else Annotated[(_content_kind(parts[0]), *more)]
    if origin in (Union, UnionType):
        return reduce(or_, (_content_kind(part) for part in parts))
    if origin is tuple:
        whole = parts[-1] is Ellipsis
        bounds = (
            Field(max_length=MOST_ENTRIES) if whole else Field(min_length=len(parts), max_length=len(parts))
        )
        item: Any = _content_kind(parts[0])
        return Annotated[list[item], bounds]
    if isinstance(origin, type) and issubclass(origin, Mapping):
        key: Any = _content_kind(parts[0])
        value: Any = _content_kind(parts[1])
        return Annotated[dict[key, value], Field(max_length=MOST_ENTRIES)]
    if isinstance(kind, type) and issubclass(kind, Stated):
        return model_of(kind)
    return _KINDS.get(kind, kind)
