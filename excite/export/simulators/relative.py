"""Paths in a model's text that still name the same files where the text stands in another folder."""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath

from excite.export.models.xml_text import Element, XmlText


def relocate_path(name: str, old: Path, new: Path) -> str:
    """A path relative to a folder, as seen from another; one that is absolute, or a URI, as it is."""
    if not name or "://" in name or PurePosixPath(name).is_absolute() or "\0" in name:
        return name
    return Path(os.path.relpath(old.resolve() / name, new.resolve())).as_posix()


def move_attribute(text: XmlText, element: Element, attribute: str, old: Path, new: Path) -> None:
    """Let an attribute that holds a path name the same file from another folder."""
    name = element.attributes.get(attribute, "")
    there = relocate_path(name, old, new)
    if there != name and there.isascii() and not set(there) & set("\"'<>&"):
        text.set(element, **{attribute: there})
