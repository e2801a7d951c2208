"""XML files as elements, within bounds of size, depth and count, and without entities."""

from __future__ import annotations

import re
from collections.abc import Sequence
from copy import copy
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.parsers.expat import errors as expat_errors

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import DefusedXMLParser

from excite.errors import InputError
from excite.reading.file import read_bytes

MAX_XML_BYTES = 64 * 1024 * 1024
# The largest model known here, a humanoid with hands in MJCF, has 6 000 elements, 26 deep, of up to 17 attributes.
MAX_ELEMENTS = 200_000
MAX_DEPTH = 200
MAX_ATTRIBUTES = 200
_UNBOUND_PREFIX = expat_errors.codes[expat_errors.XML_ERROR_UNBOUND_PREFIX]
# Comments and instructions, which hold no element, or the beginning of the outermost one.
_BEGINNINGS = re.compile(rb"<!--.*?-->|<[?!].*?>|<([A-Za-z_][\w.:-]*)", re.DOTALL)
_PREFIXED = re.compile(rb"[<\s/]([A-Za-z_][\w.-]*):[A-Za-z_]")


class _OutOfBounds(Exception):
    """What is too much, and the element at which it became so."""

    def __init__(self, what: str, tag: str):
        self.what, self.tag = what, tag
        super().__init__(what)


class _BoundedBuilder(ElementTree.TreeBuilder):
    """Builds elements as long as there are not too many, too deep, or with too many attributes."""

    def __init__(self, max_depth: int) -> None:
        super().__init__()
        self._max_depth, self._depth, self._count = max_depth, 0, 0

    def start(self, tag: Any, attrs: dict[Any, Any], /) -> ElementTree.Element:
        self._depth += 1
        self._count += 1
        if self._depth > self._max_depth:
            raise _OutOfBounds(f"elements are nested more than {self._max_depth} deep", tag)
        if self._count > MAX_ELEMENTS:
            raise _OutOfBounds(f"has more than {MAX_ELEMENTS} elements", tag)
        if len(attrs) > MAX_ATTRIBUTES:
            raise _OutOfBounds(f"has {len(attrs)} attributes", tag)
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ElementTree.Element:
        self._depth -= 1
        return super().end(tag)


def read_xml(
    path: str | Path, *, error: type[InputError] = InputError, max_depth: int = MAX_DEPTH
) -> ElementTree.Element:
    """The outermost element of an XML file.

    Args:
        path: of the file.
        error: class of the errors.
        max_depth: how deep elements may be nested.

    Raises:
        InputError: of the class ``error``: the file cannot be read, is no XML, declares entities, or has more or deeper
            elements than any model.
    """
    path = Path(path)
    return parse_xml(read_bytes(path, limit=MAX_XML_BYTES, error=error), path, error, max_depth)


def parse_xml(
    content: bytes, path: Path, error: type[InputError] = InputError, max_depth: int = MAX_DEPTH
) -> ElementTree.Element:
    """The outermost element of XML that was read from ``path``; errors as for :func:`read_xml`."""
    # Some editors and programs of embedded makers end a text with the zero byte of its string.
    content = content.rstrip(b"\0")
    try:
        try:
            return _parse_xml(content, max_depth)
        except ElementTree.ParseError as reason:
            if reason.code != _UNBOUND_PREFIX:
                raise
            return _parse_xml(_with_prefixes(content), max_depth)
    except DefusedXmlException as reason:
        raise error(
            f"declares XML entities ({type(reason).__name__})",
            source=path,
            field="DOCTYPE",
            remedy="remove the document type declaration",
        ) from reason
    except _OutOfBounds as reason:
        raise error(reason.what, source=path, field=reason.tag[:60], remedy="reduce the model") from reason
    except (ElementTree.ParseError, ValueError, LookupError) as reason:
        line = " ".join(str(reason).split())
        raise error(
            f"is not valid XML ({line[:160]})", source=path, remedy="mend the syntax there"
        ) from reason


def elements_of(text: bytes | str) -> ElementTree.Element:
    """The outermost element of a text that was read or written here before; prefixes need no declaration."""
    return parse_xml(text.encode() if isinstance(text, str) else text, Path("text"))


def _parse_xml(content: bytes, max_depth: int) -> ElementTree.Element:
    parser = DefusedXMLParser(target=_BoundedBuilder(max_depth))
    parser.feed(content)
    root: ElementTree.Element = parser.close()
    return root


def _with_prefixes(content: bytes) -> bytes:
    """The text with every prefix that stands in it declared: ROS' and Drake's readers of models ask for no declaration.

    Drake's own models have ``drake:acceleration`` and ``drake:collision_filter_group`` without one.
    """
    first = next((match for match in _BEGINNINGS.finditer(content) if match[1]), None)
    if first is None:
        return content
    declared = set(re.findall(rb"xmlns:([\w.-]+)\s*=", content))
    prefixes = sorted(set(_PREFIXED.findall(content)) - declared - {b"xmlns", b"xml"})
    said = b"".join(b' xmlns:%s="undeclared:%s"' % (prefix, prefix) for prefix in prefixes)
    return content[: first.end(1)] + said + content[first.end(1) :]


def all_alike(elements: Sequence[ElementTree.Element]) -> bool:
    """Whether elements say the same, their children and attributes included: whichever a reader takes, none is lost."""
    return len({_canonical_text(one) for one in elements}) <= 1


def _canonical_text(element: ElementTree.Element) -> str:
    alone = copy(element)
    alone.tail = None
    return ElementTree.canonicalize(ElementTree.tostring(alone, encoding="unicode"), strip_text=True)
