"""Folders of ROS packages: those called so, and those whose ``package.xml`` says the name."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from excite.errors import RobotError
from excite.reading.xml_document import read_xml

_MANIFEST = "package.xml"
# How far below a folder of packages they are looked for: a workspace holds src, clones, and packages in each of these.
_DEEP = 3


def package_folder(name: str, package_path: Iterable[Path], above: Iterable[Path] = ()) -> Path | None:
    """The folder of a package, or None.

    Folders of that name come first, unless their ``package.xml`` says another one; then those whose ``package.xml``
    says it, as ROS goes by: a clone may be called as its owner likes. At last come packages elsewhere in the clone that
    the file lies in, as of an arm's maker whose torso is another package.

    Args:
        name: of the package.
        package_path: packages, or folders in which packages lie.
        above: folders above the file that needs it, the nearest first, of which each may be the package, or hold it
            under its name.
    """
    given, outer = tuple(package_path), tuple(above)
    for place in (place for folder in (*given, *outer) for place in (folder, folder / name)):
        if place.name == name and place.is_dir() and _name(place) in (None, name):
            return place
    clone = next(((folder,) for folder in outer if (folder / ".git").exists()), ())
    inside = (place for folder in (*given, *clone) for place in _packages(folder, _DEEP))
    return next((place for place in (*outer, *inside) if _name(place) == name), None)


def _name(folder: Path) -> str | None:
    """The name in a folder's ``package.xml``; None where there is none that can be read."""
    file = folder / _MANIFEST
    if not file.is_file():
        return None
    try:
        named = read_xml(file, error=RobotError).find("name")
    except RobotError:
        return None
    return None if named is None or not named.text else named.text.strip()


def _packages(folder: Path, deep: int) -> Iterator[Path]:
    """Folders with a ``package.xml`` at and below one, hidden ones left out; packages hold no others."""
    if (folder / _MANIFEST).is_file():
        yield folder
        return
    if not deep or not os.access(folder, os.R_OK | os.X_OK) or not folder.is_dir():
        return
    for child in sorted(folder.iterdir()):
        if child.is_dir() and not child.name.startswith("."):
            yield from _packages(child, deep - 1)
