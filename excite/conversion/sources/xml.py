"""Records in XML, one after the other, as KUKA's Robot Sensor Interface sends them every cycle."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import ClassVar

import numpy as np

from excite.conversion.recording import Column, Recording, Stream, nothing_there
from excite.conversion.sources.source import MAX_NUMBERS, Source, damaged
from excite.errors import LogError
from excite.reading.file import check_file, first_bytes

# Ten times what is read as XML elsewhere; a cycle of RSI has half a kilobyte, four minutes at 250 Hz 30 MB.
_MAX_BYTES = 512 * 1024 * 1024
_TAG = re.compile(r"<([A-Za-z_][\w.-]*)[\s/>]")
# An element's attributes, or its text: nothing else of XML is looked at, so that nothing in it is expanded.
_ELEMENT = re.compile(
    r"<([A-Za-z_][\w.-]*)((?:\s+[\w.-]+\s*=\s*\"[^\"<]*\")+)\s*/?>|<([A-Za-z_][\w.-]*)>\s*([^<\s]*)\s*</?\3>"
)
_ATTRIBUTE = re.compile(r"([\w.-]+)\s*=\s*\"([^\"]*)\"")
# Outermost elements of robots' models and scenes.
_MODELS = frozenset(
    (b"robot", b"mujoco", b"mujocoinclude", b"sdf", b"COLLADA", b"launch", b"OpenSimDocument")
)
# As many records as make a recording.
_FEWEST = 20


class XmlSource(Source):
    """An element a sample, with or without one around all of them."""

    name: ClassVar[str] = "xml"
    summary: ClassVar[str] = "records in XML, as of KUKA's RSI (.xml)"

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`: by its first bytes, or by its ending."""
        if not path.is_file() or path.suffix.lower() in {".urdf", ".xacro", ".mjcf", ".sdf"}:
            return False
        start = first_bytes(path, 4096).removeprefix(b"\xef\xbb\xbf").lstrip()
        outermost = re.search(rb"<([A-Za-z_][\w.-]*)", start)
        return start[:1] == b"<" and outermost is not None and outermost[1] not in _MODELS

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        check_file(path, limit=_MAX_BYTES, error=LogError)
        try:
            text = path.read_text(encoding="utf-8-sig", errors="replace")
        except (OSError, MemoryError) as error:
            raise damaged(path, error, "XML") from error
        tag = _record_tag(text)
        if tag is None:
            raise nothing_there(path)
        rows = [_row(record) for record in re.split(rf"<{re.escape(tag)}(?=[\s>])", text)[1:]]
        names = list(dict.fromkeys(name for row in rows for name in row))
        if len(rows) * len(names) > MAX_NUMBERS:
            raise damaged(
                path, ValueError(f"{len(rows)} records of {len(names)} numbers are too many"), "XML"
            )
        none = float("nan")
        columns = (Column(name, np.array([row.get(name, none) for row in rows])) for name in names)
        kept = tuple(column for column in columns if np.isfinite(column.values).any())
        if not kept:
            raise nothing_there(path)
        return (Recording(str(path), path.stem, (Stream(path.stem, kept),)),)


def _record_tag(text: str) -> str | None:
    """The outermost element that comes again and again: the first in the file of those that do."""
    counts = Counter(_TAG.findall(text))
    return next((tag for tag in dict.fromkeys(_TAG.findall(text[:100_000])) if counts[tag] >= _FEWEST), None)


def _row(record: str) -> dict[str, float]:
    """Numbers of a record by ``ELEMENT.ATTRIBUTE``, or by the element whose text they are."""
    found: dict[str, float] = {}
    for element, attributes, named, content in _ELEMENT.findall(record):
        pairs = [(named, content)]
        if element:
            pairs = [(f"{element}.{key}", value) for key, value in _ATTRIBUTE.findall(attributes)]
        for name, value in pairs:
            try:
                found.setdefault(name, float(value.replace(",", ".")))
            except ValueError:
                continue
    return found
