"""Results that stand in JSON documents: each field once, on the result's own frozen dataclass.

What a field means, with its unit, stands in the class's docstring under ``Attributes``; its kind of value is its type.
The document (:meth:`Stated.to_json`), the check of a file that is read again and its JSON schema
(:func:`excite.documents.document.model_of`), and rows of tables come from there.
"""

from __future__ import annotations

import inspect
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, fields
from enum import Enum
from functools import cache
from pathlib import Path, PurePath
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    NamedTuple,
    Self,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from excite.atomic import write_text
from excite.provenance import stated as stated_origin

# Kinds of values that their Python type does not tell: excite.documents.document says what a file may hold of each.
Name = Annotated[str, "name"]
FilePath = Annotated[str, "path"]
InnerPath = Annotated[str, "inner path"]
"""Path of a file inside the document's folder."""
Positive = Annotated[float, "positive"]
Seconds = Annotated[float, "seconds"]
Unbounded = Annotated[float, "maybe"]
"""A number that may be infinite or NaN, for which a document has null."""
UnboundedPositive = Annotated[float, "maybe positive"]
Interval = tuple[Unbounded, Unbounded]
FEW = "few"
"""Of a table or list whose entries have a row or a panel each in a figure."""

# How a field stands in a document, where not under its own name and always.
HIDDEN = {"stated": None}
"""Of a field that no document holds."""
LEFT_OUT = {"left out": True}
"""Of a field that is left out where it is None."""
ADDED = {"added": None}
"""Of a field that documents of earlier versions lack."""


def named(name: str) -> dict[str, Any]:
    """Of a field that stands in documents under another name."""
    return {"stated": name}


def added_as(default: Any) -> dict[str, Any]:
    """Of a field that documents of earlier versions lack, which then had this value."""
    return {"added": default}


_Getter = TypeVar("_Getter", bound=Callable[..., Any])


def stated(getter: _Getter) -> _Getter:
    """Of a property, below ``@property``, or of a method without arguments: it stands in documents.

    The first line of its docstring is its meaning.
    """
    getter.__dict__["stated"] = {}
    return getter


def stated_later(getter: _Getter) -> _Getter:
    """The same of one that documents of earlier versions lack."""
    getter.__dict__["stated"] = ADDED
    return getter


def stated_with(**metadata: Any) -> Callable[[_Getter], _Getter]:
    """The same of one with more to be said, as of a field: ``stated`` its name, ``added`` what it was before."""

    def mark(getter: _Getter) -> _Getter:
        getter.__dict__["stated"] = metadata
        return getter

    return mark


class StatedField(NamedTuple):
    """A field of a document.

    Attributes:
        attribute: of the result.
        name: in the document.
        meaning: in words, with the unit.
        kind: type of its values, with what :data:`Annotated` adds.
        metadata: what else is said of it.
        source: the dataclass's field; None of a property or method.
    """

    attribute: str
    name: str
    meaning: str
    kind: Any
    metadata: Mapping[str, Any]
    source: Field[Any] | None = None

    @property
    def added(self) -> bool:
        """Whether documents of earlier versions lack it."""
        return "added" in self.metadata

    def of(self, result: Any) -> Any:
        """Its value of a result."""
        value = getattr(result, self.attribute)
        return value() if inspect.ismethod(value) else value

    @property
    def required(self) -> bool:
        """Whether a document without it is refused."""
        one = self.source
        given = one is not None and (one.default is not MISSING or one.default_factory is not MISSING)
        return not given and not self.added

    @property
    def default(self) -> Any:
        """What stands for it where a document lacks it, as plain objects."""
        if self.source is None or self.added:
            return plain(self.metadata.get("added"))
        make: Any = self.source.default_factory
        return plain(self.source.default if make is MISSING else make())


class Stated:
    """A result, or a part of one, that stands in a document.

    Attributes:
        SCHEMA: the document's field ``schema``, such as ``excite.check/1``; empty for parts.
    """

    SCHEMA: ClassVar[str] = ""

    def to_json(self) -> dict[str, Any]:
        """The document, or the object inside one, as plain objects."""
        found = {"schema": self.SCHEMA} if self.SCHEMA else {}
        for one in stated_fields(type(self)):
            value = one.of(self)
            if value is not None or "left out" not in one.metadata:
                found[one.name] = plain(value)
        return found

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """The result of its document's content, which has been checked; a field that is left out has its default."""
        found = {
            one.attribute: _read_value(one.kind, content[one.name])
            for one in stated_fields(cls)
            if one.source is not None and one.name in content
        }
        lacking = {
            one.attribute: one.default for one in stated_fields(cls) if one.source is not None and one.added
        }
        return cls(**lacking | found)

    @staticmethod
    def contradiction(found: Any) -> str:
        """What fields of a document say against each other; empty where they agree.

        Args:
            found: the fields, as attributes by their names in the document.
        """
        del found
        return ""

    def row(self, *names: str, **more: Any) -> dict[str, Any]:
        """A row of a table: the fields of those names, all where none is named, and ``more`` before them."""
        own = {one.name: one for one in stated_fields(type(self))}
        return {**more, **{name: own[name].of(self) for name in names or own}}


def _read_value(kind: Any, value: Any) -> Any:
    """A value of a document as a field of that type holds it."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _read_value(parts[0], value)
    if isinstance(value, Mapping):
        if origin in (Union, UnionType):
            return _read_value(next(part for part in parts if part is not NoneType), value)
        if origin is None and issubclass(kind, Stated):
            return kind.from_json(value)
        return {key: _read_value(parts[1], item) for key, item in value.items()} if parts else value
    if kind is Path:
        return Path(value)
    if isinstance(value, list):
        return tuple(_read_value(parts[0], item) for item in value) if origin is tuple else tuple(value)
    return value


def _fields_of(kind: type) -> tuple[StatedField, ...]:
    """What stands in a document of a result of that class, in order: fields, then properties and methods."""
    hints, meanings = get_type_hints(kind, include_extras=True), dict(field_meanings(kind))
    found = []
    for one in fields(kind):
        name = one.metadata.get("stated", one.name)
        if name is not None:
            meaning = meanings.get(one.name, "")
            found.append(StatedField(one.name, name, meaning, hints[one.name], one.metadata, one))
    for attribute, value in inspect.getmembers_static(kind):
        getter = value.fget if isinstance(value, property) else value
        metadata = getattr(getter, "__dict__", {}).get("stated")
        if isinstance(metadata, Mapping):
            returned = get_type_hints(getter, include_extras=True)["return"]
            meaning = (value.__doc__ or "").strip().partition("\n")[0].rstrip(".")
            name = metadata.get("stated", attribute)
            found.append(StatedField(attribute, name, meaning, returned, metadata))
    return tuple(found)


stated_fields: Callable[[type], tuple[StatedField, ...]] = cache(_fields_of)


def plain(value: Any) -> Any:
    """Dictionaries, lists, texts and numbers in place of results and what they hold; null for what is not finite."""
    if hasattr(value, "to_json"):
        return value.to_json()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, PurePath):
        return str(value)
    # Arrays and numpy's numbers say their content by ``tolist``, models of files by ``model_dump``.
    for method in ("tolist", "model_dump"):
        if hasattr(value, method):
            return plain(getattr(value, method)())
    return value


# A line ``name: meaning`` under ``Attributes``, and those that go on.
_ATTRIBUTE = re.compile(r"^    (\w+): (.*(?:\n {5,}.*)*)", re.MULTILINE)


def field_meanings(kind: type) -> Iterator[tuple[str, str]]:
    """What docstrings say of fields, those of bases first."""
    for base in reversed(kind.__mro__):
        text = inspect.cleandoc(base.__doc__ or "").partition("\nAttributes:\n")[2]
        for name, meaning in _ATTRIBUTE.findall(text):
            yield name, " ".join(meaning.split()).rstrip(".")


def sentence_of(kind: type) -> str:
    """The first paragraph of a class's docstring."""
    return " ".join(inspect.cleandoc(kind.__doc__ or "").partition("\n\n")[0].split())


@dataclass(frozen=True)
class Assumed(Stated):
    """Something that no file said of a robot and that was assumed.

    Attributes:
        what: what was not said.
        value: what was taken for it.
        consequence: what follows from it.
    """

    what: str
    value: str
    consequence: str

    def __str__(self) -> str:
        return f"{self.what}: {self.value} ({self.consequence})"


# JSON documents as scripts read them.


def to_json(document: dict[str, Any]) -> str:
    """One JSON document; numbers that JSON cannot hold (NaN, infinity) become null."""
    return json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False)


def write_json(document: dict[str, Any], path: Path) -> Path:
    """Write a JSON document atomically; one of a schema says which command wrote it, where one did."""
    return write_text(path, to_json(with_origin(document)) + "\n")


def with_origin(document: dict[str, Any]) -> dict[str, Any]:
    """A document of a schema with the command that makes it, where one does."""
    return {**document, **stated_origin()} if "schema" in document else document
