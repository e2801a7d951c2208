"""The formats of motions that can be read, by name. A new one is one file beside this one and one line here."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from excite.errors import MotionError, raised_as
from excite.formats.file import check_file, plain_name, unpack_file, unreadable
from excite.motion.readers.programs import KeyframesReader, OpenHrpReader, UnitreeReader, UrScriptReader
from excite.motion.readers.reader import MAX_FILE_BYTES, MotionReader, RawMotion
from excite.motion.readers.ros2 import Ros2Reader, Ros2YamlReader
from excite.motion.readers.tables import ColumnsReader, LeRobotReader, RowsReader

READERS: dict[str, type[MotionReader]] = {
    reader.name: reader
    for reader in (
        RowsReader,
        ColumnsReader,
        Ros2Reader,
        Ros2YamlReader,
        UrScriptReader,
        UnitreeReader,
        OpenHrpReader,
        KeyframesReader,
        LeRobotReader,
    )
}


def is_motion(path: Path) -> bool:
    """Whether a file or folder looks like a motion."""
    return any(reader().recognises(plain_name(path)) for reader in READERS.values())


@raised_as(MotionError)
def read_motion(path: Path, joints: Sequence[str] = ()) -> RawMotion:
    """Read a motion by the reader that knows its format.

    Raises:
        MotionError: no reader knows it, or it cannot be read.
    """
    with unpack_file(path, limit=MAX_FILE_BYTES) as plain:
        for reader in READERS.values():
            if not reader().recognises(plain):
                continue
            if not plain.is_dir():
                check_file(plain, limit=MAX_FILE_BYTES)
            with unreadable(plain):
                return reader().read(plain, joints)
    raise MotionError(
        f"unknown format {path.suffix!r}",
        source=path,
        remedy="use " + "; ".join(reader.summary for reader in READERS.values()),
    )
