"""Editing an XML text in place: elements change, everything else stays byte for byte."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from excite.errors import RobotError
from excite.formats.documents import parse_xml

_ATTRIBUTE = re.compile(rb"\s+([^\s=/>]+)\s*=\s*([\"'])(.*?)\2", re.DOTALL)
_TAG = re.compile(rb"<[^\s/>]+")


class XmlText:
    """An XML text and its elements: edit ``root``, and :meth:`edited` is the text with what changed in it.

    Attributes of elements may change, and elements may be put in, each before those that its parent has.

    Args:
        content: the file, in UTF-8 or another encoding that contains ASCII.
        source: what to name in errors.

    Raises:
        RobotError: not well-formed, UTF-16, or with declared entities.
    """

    def __init__(self, content: bytes, source: Path | str):
        if content[:2] in {b"\xff\xfe", b"\xfe\xff"}:
            raise RobotError("is UTF-16", source=source, remedy="save it as UTF-8")
        parse_xml(content, Path(source), RobotError)
        self._content = content
        self._read: dict[ElementTree.Element, tuple[int, dict[str, str]]] = {}
        builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate()

        def note_element(tag: str, attributes: dict[str, str]) -> None:
            self._read[builder.start(tag, attributes)] = parser.CurrentByteIndex, dict(attributes)

        parser.StartElementHandler = note_element
        parser.EndElementHandler = builder.end
        parser.Parse(content, True)
        self.root: ElementTree.Element = builder.close()

    def edited(self) -> bytes:
        """The text with all edits made."""
        content = self._content
        # From the end, so that places before an edit hold.
        for element, (start, before) in reversed(self._read.items()):
            new = [child for child in element if child not in self._read]
            if not new and element.attrib == before:
                continue
            tag = _TAG.match(content, start)
            last = start if tag is None else tag.end()
            edits: list[tuple[int, int, bytes]] = []
            while match := _ATTRIBUTE.match(content, last):
                name, last = match[1].decode(), match.end()
                if name not in element.attrib:
                    edits.append((*match.span(), b""))
                elif element.attrib[name] != before[name]:
                    # Inside the quotes, which stay as they are.
                    edits.append((*match.span(3), element.attrib[name].encode("ascii")))
            more = (f' {name}="{value}"' for name, value in element.attrib.items() if name not in before)
            edits.append((last, last, "".join(more).encode("ascii")))
            if new:
                lead = content[content.rfind(b"\n", 0, start) + 1 : start]
                indent = b"\n" if lead.strip() else b"\n" + lead
                inside = b"".join(
                    indent + b"  " + ElementTree.tostring(child).replace(b" />", b"/>") for child in new
                )
                head = content.index(b">", last) + 1
                if content[head - 2 : head] == b"/>":
                    closing = b">" + inside + indent + b"</" + element.tag.encode() + b">"
                    edits.append((head - 2, head, closing))
                else:
                    edits.append((head, head, inside))
            for first, end, text in reversed(edits):
                content = content[:first] + text + content[end:]
        return content
