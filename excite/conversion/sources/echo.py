"""Messages as ROS prints them: ``ros2 topic echo`` or ``rostopic echo`` into a file, parted by lines of dashes."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any, ClassVar

import yaml

from excite.conversion.recording import Recording, nothing_there
from excite.conversion.shapes.array_streams import longest_streams, stream_of_arrays
from excite.conversion.sources.json import collect_arrays
from excite.conversion.sources.source import Source, damaged
from excite.errors import LogError
from excite.reading.file import check_file, first_bytes

# Printed messages are read at a megabyte a second; an hour of an arm at 100 Hz has 300 MB.
_MAX_BYTES = 512 * 1024 * 1024
_ENDINGS = frozenset({".yaml", ".yml", ".txt", ".log", ".echo", ".msg", ""})
_FIRST = re.compile(r"[A-Za-z_]\w*:")
_LINE = re.compile(r"^---\s*$", re.MULTILINE)
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class EchoSource(Source):
    """Messages of one topic, one after the other."""

    name: ClassVar[str] = "echo"
    summary: ClassVar[str] = "messages as ros2 topic echo and rostopic echo print them"

    def recognises(self, path: Path) -> bool:
        """See :class:`Source`: fields and lines of dashes."""
        if not path.is_file() or path.suffix.lower() not in _ENDINGS:
            return False
        start = first_bytes(path, 65536).decode("utf-8", "replace").lstrip()
        return bool(_LINE.search(start)) and bool(_FIRST.match(start.removeprefix("---").lstrip()))

    def read(self, path: Path) -> tuple[Recording, ...]:
        """See :class:`Source`."""
        check_file(path, limit=_MAX_BYTES, error=LogError)
        try:
            parts = _LINE.split(path.read_text(encoding="utf-8", errors="replace"))
            messages = [message for part in parts if isinstance(message := _parse_message(part), dict)]
        except (OSError, ValueError, yaml.YAMLError, RecursionError, MemoryError) as error:
            raise damaged(path, error, "printed messages") from error
        arrays: dict[str, Any] = {}
        said: dict[str, object] = {}
        alike, notes = _of_most_joints(messages)
        collect_arrays("", alike, arrays, said, 0)
        streams = longest_streams(stream_of_arrays(path.stem, arrays))
        if not streams:
            raise nothing_there(path)
        return (Recording(str(path), path.stem, streams, said, notes),)


def _parse_message(text: str) -> object:
    """A message's fields; None for one that was cut off."""
    if "&" in text:
        # No message has references, which may stand for more than there is memory.
        return None
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError:
        return None


def _of_most_joints(messages: list[dict[str, Any]]) -> tuple[list[dict[str, Any]], tuple[str, ...]]:
    """Messages that name the same joints, of several publishers those of most joints; a note of the others."""
    names = [str(message.get("name", message.get("joint_names", ""))) for message in messages]
    counts = Counter(names)
    best = max(counts, key=lambda name: (name.count(","), counts[name]), default="")
    alike = [message for message, name in zip(messages, names, strict=True) if name == best]
    others = len(messages) - len(alike)
    return alike, (f"{others} messages name other joints: left out",) if others else ()
