"""The motion library: ready sets of safe motions for the bundled robots."""

from __future__ import annotations

from pathlib import Path

from excite.errors import UnknownNameError
from excite.robot.catalogue import data_folder


def library_names() -> list[str]:
    """Names of the robots that the library has motions for, sorted."""
    return sorted(path.parent.name for path in data_folder("motion_library").glob("*/motions"))


def library_folder(name: str) -> Path:
    """Folder of a robot's set: ``motions/``, ``check.json``, ``conditioning.json``, ``motions.png``.

    Raises:
        UnknownNameError: the library has no set of that name.
    """
    if name not in library_names():
        raise UnknownNameError("motion set", name, library_names())
    return data_folder("motion_library") / name
