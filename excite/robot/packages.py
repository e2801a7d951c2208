"""Folders of ROS packages: those called so, and those whose ``package.xml`` says the name."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path

from excite.errors import RobotError
from excite.reading.xml_document import read_xml

_MANIFEST = "package.xml"
# How far below a folder of packages they are looked for: a workspace holds src, clones, and packages in each of these.
_DEEP = 3


def package_folder(name: str, package_path: Iterable[Path], above: Iterable[Path] = ()) -> Path | None:
    """The folder of a package, or None.

    What a ``package.xml`` says goes first, as ROS goes by it: a clone may be called as its owner likes, and a folder
    of that name further up may be anything. Packages elsewhere in the clone that the file lies in are looked at too, as
    of an arm's maker whose torso is another package. Then come folders called so, which say no other name.

    Args:
        name: of the package.
        package_path: packages, or folders in which packages lie.
        above: folders above the file that needs it, the nearest first, of which each may be the package, or hold it
            under its name.
    """
    given, outer = tuple(package_path), tuple(above)
    near, far = ([*_folders_named(name, folders)] for folders in (given, outer))
    clone = next(((folder,) for folder in outer if (folder / ".git").exists()), ())
    said = (place for place in (*near, *far, *outer) if _package_name(place) == name)
    inside = (
        place
        for folder in (*given, *clone)
        for place in _find_packages(folder, _DEEP)
        if _package_name(place) == name
    )
    unsaid_near, unsaid_far = (
        [place for place in places if _package_name(place) is None] for places in (near, far)
    )
    return next(chain(said, unsaid_near, inside, unsaid_far), None)


def _folders_named(name: str, folders: Iterable[Path]) -> Iterator[Path]:
    """Folders of that name, of which each given one may be one, or hold one."""
    for place in (place for folder in folders for place in (folder, folder / name)):
        if place.name == name and place.is_dir():
            yield place


def _package_name(folder: Path) -> str | None:
    """The name in a folder's ``package.xml``; None where there is none that can be read."""
    file = folder / _MANIFEST
    if not file.is_file():
        return None
    try:
        named = read_xml(file, error=RobotError).find("name")
    except RobotError:
        return None
    return None if named is None or not named.text else named.text.strip()


def _find_packages(folder: Path, deep: int) -> Iterator[Path]:
    """Folders with a ``package.xml`` at and below one, hidden ones left out; packages hold no others."""
    if (folder / _MANIFEST).is_file():
        yield folder
        return
    if not deep or not os.access(folder, os.R_OK | os.X_OK) or not folder.is_dir():
        return
    for child in sorted(folder.iterdir()):
        if child.is_dir() and not child.name.startswith("."):
            yield from _find_packages(child, deep - 1)
