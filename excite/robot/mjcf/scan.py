"""MuJoCo model files looked through before MuJoCo sees them: what they include, how large they become, their numbers.

A line of MJCF can stand for a billion bodies (``replicate``, ``composite``, ``flexcomp``), name a pipe as a mesh, or
include itself; MuJoCo then takes all memory, waits for ever, or ends the process.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

from excite.errors import RobotError
from excite.formats.documents import read_xml
from excite.formats.file import check_file, unreadable_file
from excite.robot.quantities import MAX_MASS
from excite.robot.refusal import robot_error
from excite.robot.urdf.numbers import shorten_text

# The largest model known, a rodent with muscles and skin, has 4 000 elements in 5 files, 30 deep.
MAX_EXPANDED = 100_000
MAX_DEPTH = 100
MAX_FILES = 200

_MULTIPLIERS = ("replicate", "composite", "flexcomp")
# Elements without which nothing in a model can move; files and models that are brought in may hold bodies.
_WITH_BODIES = ("worldbody//body", "worldbody//composite", "worldbody//flexcomp", "include", "attach")
_FOLDERS = ("meshdir", "texturedir", "assetdir")
_ASSETS = ("mesh", "texture", "hfield", "skin", "flexcomp", "composite", "plugin")


def scan_mjcf(path: Path) -> None:
    """Refuse a MuJoCo model that would be too large, includes what is no file, or holds numbers that are none.

    Raises:
        RobotError: names file, element and what to do.
    """
    scan = _Scan(path.parent)
    root = scan.read(path)
    if root.tag != "mujoco":
        raise robot_error(
            path,
            None,
            f"is no MuJoCo model: its outermost element is <{root.tag[:60]}>, not <mujoco>",
            "give an MJCF file",
        )
    if all(root.find(f".//{tag}") is None for tag in _WITH_BODIES):
        raise robot_error(
            path,
            "worldbody",
            "holds no <body>: it is a part of a MuJoCo model, for the <include> of another file",
            "give the file that includes it",
        )
    scan.size(root, (path,), 0)
    scan.check_assets()


@dataclass
class _Scan:
    """What was seen so far.

    Attributes:
        folder: folder of the model's main file, to which all paths are relative.
        files: how many files were read.
        folders: folders that the model names for its assets.
        assets: files that it names, with the element that names them.
        models: size of each model that may be attached, by name.
    """

    folder: Path
    files: int = 0
    folders: set[str] = field(default_factory=lambda: {""})
    assets: list[tuple[str, str]] = field(default_factory=list)
    models: dict[str, int] = field(default_factory=dict)

    def read(self, path: Path) -> ElementTree.Element:
        self.files += 1
        if self.files > MAX_FILES:
            raise robot_error(
                path, None, f"is made of more than {MAX_FILES} files", "reduce what it includes"
            )
        root = read_xml(path, error=RobotError, max_depth=MAX_DEPTH)
        # Attached models may be named before or after the place where they are used.
        for model in root.iter("model"):
            self.models.setdefault(_model_name(model), 0)
        return root

    def size(self, element: ElementTree.Element, files: tuple[Path, ...], depth: int) -> int:
        """Number of elements that an element becomes; checks everything below it."""
        path, tag = files[-1], element.tag
        if depth > MAX_DEPTH:
            raise robot_error(path, tag[:60], f"elements are nested more than {MAX_DEPTH} deep", "flatten it")
        check_numbers(element, path)
        below = 1
        if tag == "include" or (tag == "model" and "file" in element.attrib):
            below += self._other(element, files, depth)
        elif tag == "compiler":
            self.folders |= {element.get(key, "") for key in _FOLDERS}
        elif tag in _ASSETS:
            self.assets += [(value, tag) for key, value in element.items() if key.startswith("file")]
        if tag == "attach":
            below += self.models.get(element.get("model", ""), 0)
        # Assets come first, so that models are known where they are attached.
        for child in sorted(element, key=lambda child: child.tag not in {"compiler", "asset"}):
            below += self.size(child, files, depth + 1)
        total = below * (count_copies(element, path) if tag in _MULTIPLIERS else 1)
        if total > MAX_EXPANDED:
            raise robot_error(
                path,
                f"{tag}@count" if tag in _MULTIPLIERS else tag,
                f"stands for more than {MAX_EXPANDED} elements",
                "repeat less",
            )
        return total

    def _other(self, element: ElementTree.Element, files: tuple[Path, ...], depth: int) -> int:
        """Size of another file that an element brings in."""
        named = element.get("file", "")
        if not named:
            raise robot_error(files[-1], f"{element.tag}@file", "is missing", "name it")
        other = self._found(named, files[-1])
        same = [file for file in files if other.exists() and file.exists() and file.samefile(other)]
        if same:
            raise robot_error(
                files[-1], f"{element.tag}@file", f"includes itself through {named!r}", "remove it"
            )
        size = self.size(self.read(other), (*files, other), depth + 1)
        if element.tag == "model":
            name = _model_name(element)
            self.models[name] = max(self.models.get(name, 0), size)
        return size

    def _found(self, named: str, by: Path) -> Path:
        """File of that name; MuJoCo takes it relative to the main file, other tools to the one that names it."""
        places = [self.folder / named, by.parent / named]
        return next((place for place in places if os.path.exists(place)), places[0])

    def check_assets(self) -> None:
        """Refuse meshes and pictures that are no files or too large; those that are not there are the compiler's."""
        for named, tag in self.assets:
            for folder in self.folders:
                file = self.folder / folder / named
                try:
                    file.stat()
                except (FileNotFoundError, NotADirectoryError):
                    continue
                except (OSError, ValueError) as reason:
                    raise unreadable_file(file, reason, RobotError) from reason
                if named and not (folder and file.is_dir() and tag == "plugin"):
                    # The largest mesh known has 29 MB; MuJoCo itself refuses meshes of more than 16 000 000 corners.
                    check_file(file, limit=256 * 1024 * 1024, error=RobotError)


def _model_name(model: ElementTree.Element) -> str:
    return model.get("name") or Path(model.get("file", "")).stem


# Numbers in the attributes of a MuJoCo model: finite, of a size that something has, and counts that end.

# Gains of 1e5 and stand-ins for "no limit" of 1e6 occur; MuJoCo itself takes 1e10 for the end of all numbers.
MAX_NUMBER = 1e10
# Joints are locked by a damping of 1e11 in models that are made for learning.
MAX_DAMPING = 1e15
# Osmium has 22 600 kg/m³; a density a hundredfold is a slip of unit.
MAX_DENSITY = 1e6
# Buffers of a humanoid in a crowd have some thousands; each of these reserves memory for every one.
MAX_RESERVED = 1_000_000
# A picture or a height field of 8192 by 8192 points has 200 MB.
MAX_SIDE = 8192
MAX_MEMORY_BYTES = 4e9

# Attributes that hold words, which may look like numbers.
_WORDS = {
    "name", "class", "childclass", "model", "file", "prefix", "plugin", "instance", "key", "value",
    "joint", "joint1", "joint2", "body", "body1", "body2", "geom", "geom1", "geom2", "site", "site1", "site2",
    "mesh", "material", "texture", "hfield", "tendon", "tendon1", "tendon2", "actuator", "sensor", "target",
    "objname", "refname", "reftype", "objtype", "jointinparent", "sidesite", "refsite", "cranksite", "slidersite",
    "flex", "skin", "content_type", "dclass", "gridlayout", "quat_order", "eulerseq",
}  # fmt: skip
# Attributes and elements, all where none are named, the largest number there, and what to do about a larger one.
_LARGEST: tuple[tuple[set[str], set[str], float, str], ...] = (
    (set(), {"size"}, MAX_RESERVED, "reserve less"),
    ({"nrow", "ncol", "width", "height"}, {"hfield", "texture"}, MAX_SIDE, "reduce its size"),
    ({"mass", "settotalmass", "boundmass"}, set(), MAX_MASS, "write kilograms"),
    ({"damping"}, {"joint"}, MAX_DAMPING, "leave the joint out, where it shall not move"),
    ({"density"}, set(), MAX_DENSITY, "write kg/m³"),
    (set(), set(), MAX_NUMBER, "check its unit and exponent"),
)
_NOT_FINITE = re.compile(r"(?<![\w.])[+-]?(nan|inf|infinity)(?![\w.])", re.IGNORECASE)
_UNITS = {"": 1.0, "k": 2.0**10, "m": 2.0**20, "g": 2.0**30, "t": 2.0**40, "p": 2.0**50, "e": 2.0**60}


def check_numbers(element: ElementTree.Element, path: Path) -> None:
    """Refuse an element whose attributes hold numbers that are none, or that no model has; raises RobotError."""
    for name, text in element.items():
        if name in _WORDS:
            continue
        called = f" {shorten_text(element.get('name', ''))!r}" if element.get("name") else ""
        where = f"{element.tag}{called}@{name}"
        if name == "memory":
            _check_memory(text, path, where)
        elif _NOT_FINITE.search(text):
            raise robot_error(path, where, f"is {shorten_text(text)!r}", "give finite numbers")
        else:
            _check_magnitudes(element, name, text, path, where)


def count_copies(element: ElementTree.Element, path: Path) -> int:
    """How many copies ``count_copies`` says, the product of its numbers; raises RobotError."""
    text = element.get("count", "1")
    product = 1
    for part in text.split():
        if not re.fullmatch(r"[+-]?\d+", part, re.ASCII):
            raise robot_error(
                path, f"{element.tag}@count", f"is {shorten_text(text)!r}", "give whole numbers"
            )
        # Negative ones are MuJoCo's to refuse.
        product *= max(1, int(part)) if len(part) < 20 else 10**20
    return product


def _check_magnitudes(element: ElementTree.Element, name: str, text: str, path: Path, where: str) -> None:
    most, cause = next(
        (most, cause)
        for names, tags, most, cause in _LARGEST
        if name in (names or {name}) and element.tag in (tags or {element.tag})
    )
    for part in text.split():
        try:
            value = float(part)
        except ValueError:
            continue
        said = f"is {shorten_text(text)!r}"
        if not part.isascii():
            raise robot_error(path, where, said, "write it with the digits 0 to 9")
        if not abs(value) <= most:
            raise robot_error(path, where, f"{said}, more than any model has ({most:g})", cause)
        if name in {"mass", "density"} and value < 0.0 and element.tag != "compiler":
            raise robot_error(path, where, f"is {part}", "give a positive number")


def _check_memory(text: str, path: Path, where: str) -> None:
    match = re.fullmatch(r"(-?\d+)\s*([kmgtpe]?)", text.strip().lower(), re.ASCII)
    if match is None:
        return
    if len(match[1]) > 20 or float(match[1]) * _UNITS[match[2]] > MAX_MEMORY_BYTES:
        what = f"is {shorten_text(text)!r}, more than {MAX_MEMORY_BYTES:g} bytes"
        raise robot_error(path, where, what, "leave it out; MuJoCo sizes it")
