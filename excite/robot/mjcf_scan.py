"""What is in a MuJoCo model file, looked at before MuJoCo reads it.

MuJoCo takes a model at its word: it repeats a body a hundred million times, waits at a pipe that is included, and
drops an offset that is no number. Files and counts are bounded here, so that what is left is a model.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

from excite.errors import RobotError
from excite.reading.file import check_file
from excite.reading.xml_document import MAX_ELEMENTS, MAX_XML_BYTES, read_xml
from excite.robot.meshes import MAX_MESH_BYTES

# The most of 161 published models is 5.
MAX_FILES = 100
# What replicated elements may amount to in all; the largest known model has 6 000 elements as written.
MAX_COPIES = MAX_ELEMENTS
# Texels, height samples and other table entries: a texture of 8192 × 8192 has this many.
MAX_CELLS = 64 * 1024 * 1024
# Keyframes, constraints, user data: 300 000 is the largest found.
MAX_COUNT = 10_000_000
# 1e10 stands for "no limit" in forces and ranges.
MAX_NUMBER = 1e12

# Tables whose memory is the product of these.
_TABLES = {"texture": ("width", "height"), "hfield": ("nrow", "ncol")}
_ASSETS = {"mesh", "hfield", "skin", "texture"}
_GEOMETRIC = {
    "pos", "quat", "euler", "axisangle", "xyaxes", "zaxis", "axis", "range", "ref", "mass", "diaginertia",
    "fullinertia", "size", "fromto", "density", "scale", "armature", "gear", "polycoef", "anchor",
    "boundmass", "boundinertia", "settotalmass", "forcerange", "ctrlrange", "actuatorfrcrange",
}  # fmt: skip
_COUNT = re.compile(r"\d+", re.ASCII)


def scan_mjcf(path: Path) -> None:
    """Refuse a MuJoCo model that MuJoCo should not be given; it is not compiled.

    Args:
        path: the model; files that it includes lie in its folder, below it or in the folder above.

    Raises:
        RobotError: a file is missing, no regular file or too large; an element is repeated, or a table or count is
            larger than in any model; a number is none.
    """
    scan = _Scan(path)
    scan.read(check_file(path, limit=MAX_XML_BYTES, error=RobotError))


@dataclass(eq=False)
class _Scan:
    """A model while its files are looked at: files seen, elements counted, folders of its assets."""

    model: Path
    seen: set[Path] = field(default_factory=set)
    folders: set[Path] = field(default_factory=set)
    copies: int = 0

    def read(self, path: Path) -> None:
        resolved = path.resolve()
        if resolved in self.seen:
            raise RobotError(
                "is included twice", source=self.model, field=path.name, remedy="include it once"
            )
        self.seen.add(resolved)
        if len(self.seen) > MAX_FILES:
            raise RobotError(f"includes more than {MAX_FILES} files", source=self.model, remedy="join them")
        root = read_xml(path, error=RobotError)
        self.folders.add(path.parent)
        for compiler in root.iter("compiler"):
            for key in ("meshdir", "texturedir", "assetdir"):
                self.folders.add(self.model.parent / compiler.get(key, ""))
        for element, factor in _elements(root, 1):
            self.copies += factor
            if self.copies > MAX_COPIES:
                raise RobotError(
                    f"stands for more than {MAX_COPIES} elements",
                    source=path,
                    field=element.tag,
                    remedy="reduce the count of its replicate elements",
                )
            _check_element(element, path)
            if element.get("file"):
                self.follow(element, path)

    def follow(self, element: ElementTree.Element, path: Path) -> None:
        """Scan the model that an element includes; check a file of another kind."""
        name = element.get("file", "")
        if element.tag in _ASSETS:
            for file in (folder / name for folder in sorted(self.folders)):
                # A mesh that is not there may be left out later.
                if os.path.exists(file):
                    check_file(file, limit=MAX_MESH_BYTES, error=RobotError)
        if element.tag not in {"include", "model"}:
            return
        places = (self.model.parent / name, path.parent / name)
        file = check_file(
            next((place for place in places if os.path.exists(place)), places[0]),
            limit=MAX_XML_BYTES,
            error=RobotError,
        )
        if not file.resolve().is_relative_to(self.model.resolve().parent.parent):
            raise RobotError(
                "lies outside the model's folder",
                source=path,
                field=f"{element.tag} {name[:60]!r}",
                remedy="put it beside the model",
            )
        self.read(file)


def _elements(element: ElementTree.Element, factor: int) -> Iterator[tuple[ElementTree.Element, int]]:
    """Every element, with how often it will stand in the model."""
    yield element, factor
    if element.tag == "replicate":
        # More than any bound is enough.
        factor = min(factor * _count(element.get("count", "1")), 10 * MAX_COPIES)
    for child in element:
        yield from _elements(child, factor)


def _count(text: str) -> int:
    """A count as MuJoCo may understand it; 0 where it will refuse the text itself."""
    text = text.strip()
    return int(text[:18]) if _COUNT.fullmatch(text[:18]) else 0


def _check_element(element: ElementTree.Element, path: Path) -> None:
    where = element.tag + (f" {element.get('name')!r}" if element.get("name") else "")
    if element.tag in {"flexcomp", "flex"}:
        raise RobotError("is deformable", source=path, field=where, remedy="remove it")
    if element.tag in {"plugin", "lengthrange"}:
        what = "is a plugin, which a URDF does not have" if element.tag == "plugin" else "runs a simulation"
        raise RobotError(what, source=path, field=where, remedy="remove it")
    cells = math.prod(_count(element.get(side, "0")) for side in _TABLES.get(element.tag, ()))
    if element.tag in _TABLES and cells > MAX_CELLS:
        sides = " × ".join(_TABLES[element.tag])
        raise RobotError(
            f"has {cells} cells ({sides})", source=path, field=where, remedy=f"at most {MAX_CELLS} are read"
        )
    if element.tag == "size":
        _check_counts(element, path)
    for attribute, text in element.attrib.items():
        if attribute in _GEOMETRIC:
            _check_numbers(text, f"{where}@{attribute}", path)


def _check_counts(element: ElementTree.Element, path: Path) -> None:
    for attribute, text in element.attrib.items():
        # The arena is not needed to read a model; its text has a suffix such as M.
        amount = _count(text.rstrip("KMGTPE"))
        if amount > MAX_COUNT * (100 if attribute == "memory" and amount == _count(text) else 1):
            raise RobotError(
                f"is {text[:40]}", source=path, field=f"size@{attribute}", remedy="remove it, or reduce it"
            )


def _check_numbers(text: str, where: str, path: Path) -> None:
    for part in text.split():
        try:
            value = float(part)
        except ValueError:
            # A word, as of fromto and type; MuJoCo says what it thinks of it.
            continue
        if math.isnan(value) or (math.isfinite(value) and abs(value) > MAX_NUMBER):
            raise RobotError(
                f"is {part[:40]!r}", source=path, field=where, remedy="give a number in SI units"
            )
