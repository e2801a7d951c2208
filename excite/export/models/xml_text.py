"""Editing an XML text in place: attributes change, everything else stays byte for byte."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

from excite.arrays import Array
from excite.errors import RobotError
from excite.formats.documents import parse_xml

_ATTRIBUTE = re.compile(rb"\s+([^\s=/>]+)\s*=\s*(\"[^\"]*\"|'[^']*')")
_TAG = re.compile(rb"<[^\s/>]+")


@dataclass(frozen=True, eq=False)
class Element:
    """An element and where it stands.

    Attributes:
        tag: its name.
        attributes: its attributes, entities resolved.
        children: elements directly inside it, in order.
        start: offset of its ``<``.
        head: offset just after its start tag.
        end: offset just after all of it.
    """

    tag: str
    attributes: Mapping[str, str]
    children: list[Element]
    start: int
    head: int
    end: int

    def named(self, tag: str) -> list[Element]:
        """Children of that name."""
        return [child for child in self.children if child.tag == tag]

    def everywhere(self, tag: str) -> Iterator[Element]:
        """Elements of that name at any depth below, in order."""
        for child in self.children:
            if child.tag == tag:
                yield child
            yield from child.everywhere(tag)


class XmlText:
    """An XML text, its elements' places, and the edits collected so far.

    Args:
        content: the file, in UTF-8 or another encoding that contains ASCII.
        source: what to name in errors.

    Raises:
        RobotError: not well-formed, UTF-16, or with declared entities.
    """

    def __init__(self, content: bytes, source: Path | str):
        self.source = source
        self._content = content
        self._edits: list[tuple[int, int, bytes]] = []
        self._attributes: dict[int, dict[str, str]] = {}
        self.root = _parse_xml_text(content, source)
        self._by_start = {element.start: element for element in [self.root, *_all_elements(self.root)]}

    def set(self, element: Element, **values: str) -> None:
        """Give attributes new values; one that is absent is added behind the others."""
        self._attributes.setdefault(element.start, {}).update(values)

    def insert_first(self, element: Element, text: str) -> None:
        """Put a new element (one line) before the first child of ``element``, indented like its siblings."""
        line = self._content.rfind(b"\n", 0, element.start) + 1
        lead = self._content[line : element.start]
        indent = lead if not lead.strip() else b""
        new = b"\n" + indent + b"  " + text.encode("ascii")
        if self._content[element.head - 2 : element.head] == b"/>":
            closing = b">" + new + b"\n" + indent + b"</" + element.tag.encode() + b">"
            self._edits.append((element.head - 2, element.head, closing))
        else:
            self._edits.append((element.head, element.head, new))

    def remove_attribute(self, element: Element, name: str) -> None:
        """Take an attribute away, with the space before it."""
        for match in self._matches(element):
            if match[1].decode() == name:
                self._edits.append((match.start(), match.end(), b""))

    def edited(self) -> bytes:
        """The text with all edits made."""
        edits = [*self._edits]
        for start, values in self._attributes.items():
            edits += self._attribute_edits(self._by_start[start], values)
        content = self._content
        for start, end, new in sorted(edits, key=lambda edit: (edit[0], edit[1]), reverse=True):
            content = content[:start] + new + content[end:]
        return content

    def _attribute_edits(self, element: Element, values: Mapping[str, str]) -> list[tuple[int, int, bytes]]:
        edits, last = [], element.start + len(_start_tag(self._content, element.start))
        found = set()
        for match in self._matches(element):
            name, last = match[1].decode(), match.end()
            if name in values:
                found.add(name)
                # Inside the quotes, which stay as they are.
                edits.append((match.start(2) + 1, match.end(2) - 1, values[name].encode("ascii")))
        added = "".join(f' {name}="{value}"' for name, value in values.items() if name not in found)
        return [*edits, (last, last, added.encode("ascii"))] if added else edits

    def _matches(self, element: Element) -> Iterator[re.Match[bytes]]:
        position = element.start + len(_start_tag(self._content, element.start))
        while match := _ATTRIBUTE.match(self._content, position, element.head):
            yield match
            position = match.end()


def number_text(*values: float) -> str:
    """Numbers as an attribute's text, with as many digits as it takes to read the same ones back."""
    return " ".join(repr(float(value) + 0.0) for value in values)


MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
"""Moments of inertia in the order in which URDF and SDF have them."""
UPPER = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])
"""Places of :data:`MOMENTS` in a matrix."""


def moment_texts(inertia: Array) -> dict[str, str]:
    """Moments of an inertia ``(3, 3)`` as attributes."""
    return {name: number_text(value) for name, value in zip(MOMENTS, inertia[UPPER], strict=True)}


def _all_elements(element: Element) -> Iterator[Element]:
    for child in element.children:
        yield child
        yield from _all_elements(child)


def _start_tag(content: bytes, start: int) -> bytes:
    match = _TAG.match(content, start)
    return match[0] if match else b"<"


def _start_tag_end(content: bytes, start: int) -> int:
    """Offset just after the start tag at ``start``; ``>`` may stand inside quotes."""
    position = start + len(_start_tag(content, start))
    while match := _ATTRIBUTE.match(content, position):
        position = match.end()
    return content.index(b">", position) + 1


def _parse_xml_text(content: bytes, source: Path | str) -> Element:
    if content[:2] in {b"\xff\xfe", b"\xfe\xff"}:
        raise RobotError("is UTF-16", source=source, remedy="save it as UTF-8")
    parse_xml(content, Path(source), RobotError)
    top: list[Element] = []
    stack: list[tuple[str, dict[str, str], int, list[Element]]] = []
    parser = expat.ParserCreate()

    def opened(tag: str, attributes: dict[str, str]) -> None:
        stack.append((tag, attributes, parser.CurrentByteIndex, []))

    def closed(_: str) -> None:
        tag, attributes, start, children = stack.pop()
        head = _start_tag_end(content, start)
        empty = content[head - 2 : head] == b"/>"
        end = head if empty else content.index(b">", parser.CurrentByteIndex) + 1
        siblings = stack[-1][3] if stack else top
        siblings.append(Element(tag, attributes, children, start, head, end))

    parser.StartElementHandler = opened
    parser.EndElementHandler = closed
    parser.Parse(content, True)
    return top[0]
