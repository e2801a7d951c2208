"""From a MuJoCo model file (MJCF) to a URDF: what can be said in one is, what cannot is refused by name.

Files are looked through before MuJoCo sees them: a line of MJCF can stand for a billion bodies (``replicate``,
``composite``, ``flexcomp``), name a pipe as a mesh, or include itself; MuJoCo then takes all memory, waits for ever, or
ends the process.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from xml.etree.ElementTree import Element

from excite.errors import InputError, RobotError, raised_as
from excite.formats.child import in_child
from excite.formats.documents import read_xml
from excite.formats.file import check_file, unreadable_file
from excite.robot.refusal import robot_error
from excite.robot.urdf.converted import ConvertedModel
from excite.robot.urdf.numbers import shorten_text

# The largest model known, a rodent with muscles and skin, has 4 000 elements in 5 files, 30 deep.
MAX_EXPANDED, MAX_DEPTH, MAX_FILES = 100_000, 100, 200
_NOT_FINITE = {"nan", "inf", "infinity"}

# Elements without which nothing in a model can move; files and models that are brought in may hold bodies.
_WITH_BODIES = ("worldbody//body", "worldbody//composite", "worldbody//flexcomp", "include", "attach")
# Of a height field and a picture; one of 8192 points a side has 200 MB.
_SIDES = {"hfield": ("nrow", "ncol"), "texture": ("width", "height")}
_ASSETS = ("mesh", "texture", "hfield", "skin", "flexcomp", "composite", "plugin")


@raised_as(RobotError)
def scan_mjcf(path: Path) -> None:
    """Refuse a MuJoCo model that would be too large, includes what is no file, or holds numbers that are none.

    Raises:
        RobotError: names file, element and what to do.
    """
    waiting, folders, assets = [path], {""}, list[tuple[str, str]]()
    for number, file in enumerate(waiting):
        if number == MAX_FILES:
            raise robot_error(
                file, None, f"is made of more than {MAX_FILES} files", "reduce what it includes"
            )
        root = read_xml(file, max_depth=MAX_DEPTH)
        if not number:
            _check_whole(root, path)
        _count_elements(root, file)
        for element in root.iter():
            tag = element.tag
            if tag == "include" or (tag == "model" and "file" in element.attrib):
                brought = _brought_in(element, path, file)
                waiting += [] if brought in waiting else [brought]
            elif tag == "compiler":
                folders |= {element.get(key, "") for key in ("meshdir", "texturedir", "assetdir")}
            elif tag in _ASSETS:
                assets += [(value, tag) for key, value in element.items() if key.startswith("file")]
    for named, tag in assets:
        for folder in folders:
            may_be_folder = not named or (tag == "plugin" and bool(folder))
            _check_asset(path.parent / folder / named, may_be_folder=may_be_folder)


def _check_whole(root: Element, path: Path) -> None:
    if root.tag != "mujoco":
        what = f"is no MuJoCo model: its outermost element is <{root.tag[:60]}>, not <mujoco>"
        raise robot_error(path, None, what, "give an MJCF file")
    if all(root.find(f".//{tag}") is None for tag in _WITH_BODIES):
        what = "holds no <body>: it is a part of a MuJoCo model, for the <include> of another file"
        raise robot_error(path, "worldbody", what, "give the file that includes it")


def _count_elements(element: Element, path: Path) -> int:
    """How many elements an element becomes, of its own file; what else is beyond all models is refused on the way."""
    tag, repeats = element.tag, element.tag in ("replicate", "composite", "flexcomp")
    for key, text in element.items():
        if key != "name" and _NOT_FINITE & {part.lstrip("+-") for part in text.lower().split()}:
            raise _error_at(element, key, path, f"is {shorten_text(text)!r}", "give finite numbers")
    total = 1 + sum(_count_elements(child, path) for child in element)
    for part in element.get("count", "1").split() if repeats else ():
        if not re.fullmatch(r"[+-]?\d+", part, re.ASCII):
            raise _error_at(element, "count", path, f"is {shorten_text(part)!r}", "give whole numbers")
        # Negative ones are MuJoCo's to refuse; more digits than Python reads are too many anyway.
        total *= max(1, int(part[:20]))
    if total > MAX_EXPANDED:
        raise _error_at(
            element, "count", path, f"stands for more than {MAX_EXPANDED} elements", "repeat less"
        )
    for side in _SIDES.get(tag, ()):
        if len(element.get(side, "")) > 4:
            raise _error_at(element, side, path, "is more than 9999", "reduce its size")
    return total


def _error_at(element: Element, key: str, path: Path, what: str, remedy: str) -> RobotError:
    called = f" {shorten_text(element.get('name', ''))!r}" if element.get("name") else ""
    return robot_error(path, f"{element.tag}{called}@{key}", what, remedy)


def _brought_in(element: Element, first: Path, last: Path) -> Path:
    """The file that an element of the last file brings in.

    MuJoCo takes its name relative to the first, other tools to the one that names it. Circles of several files are its
    to refuse.
    """
    named = element.get("file", "")
    if not named:
        raise _error_at(element, "file", last, "is missing", "name it")
    places = [file.parent / named for file in (first, last)]
    other = next((one for one in places if os.path.exists(one)), places[0])
    if os.path.exists(other) and any(other.samefile(file) for file in (first, last)):
        raise _error_at(element, "file", last, f"includes itself through {named!r}", "remove it")
    return other


def _check_asset(file: Path, *, may_be_folder: bool) -> None:
    """Refuse a mesh or picture that is no file or too large; one that is not there is the compiler's."""
    try:
        file.stat()
    except (FileNotFoundError, NotADirectoryError):
        return
    except (OSError, ValueError) as reason:
        raise unreadable_file(file, reason) from reason
    if not (may_be_folder and file.is_dir()):
        # The largest mesh known has 29 MB; MuJoCo itself refuses meshes of more than 16 000 000 corners.
        check_file(file, limit=256 * 1024 * 1024)


# The largest model known, a humanoid with hands and 60 meshes, takes 3 s and 0.6 GB.
COMPILE_SECONDS = 40.0
COMPILE_MEMORY_GB = 8.0


def is_mjcf(path: Path) -> bool:
    """Whether a file is a MuJoCo model: XML whose outermost element is ``mujoco``; False if it cannot be read."""
    try:
        return read_xml(path).tag == "mujoco"
    except InputError:
        return False


@raised_as(RobotError)
def convert_mjcf(path: Path) -> ConvertedModel:
    """Read a MuJoCo model and write it as a URDF.

    The model is compiled by MuJoCo, in a process of its own, so defaults, includes, orientations of every kind
    and inertias that follow from geometry are as MuJoCo understands them. Bodies, hinges and slides, inertials,
    primitive solids and meshes are carried over; a joint coupled to another by a linear equality becomes a mimic
    joint, and other equalities loops and couplings of a ``robot.yaml``, where their joints without a motor follow
    from those with one; else these are held still, as are all joints that no motor drives where others have one.

    Returns:
        The conversion.

    Raises:
        RobotError: MuJoCo cannot compile it, or it holds what no tree of hinges and slides can say: ball
            joints, several robots of which one floats, tendons along paths in space, deformable bodies,
            or a mesh that is not there although a body's inertia depends on it; or it is too large, or makes
            MuJoCo crash, hang or take all memory.
    """
    path = Path(path)
    scan_mjcf(path)
    conversion: ConvertedModel = in_child(
        "excite.robot.mjcf.compiled:compile_mjcf",
        path,
        source=path,
        seconds=COMPILE_SECONDS,
        memory_gb=COMPILE_MEMORY_GB,
    )
    return conversion
