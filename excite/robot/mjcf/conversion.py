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
from excite.robot.quantities import MAX_MASS
from excite.robot.refusal import robot_error
from excite.robot.urdf.converted import ConvertedModel
from excite.robot.urdf.numbers import shorten_text

# The largest model known, a rodent with muscles and skin, has 4 000 elements in 5 files, 30 deep.
MAX_EXPANDED, MAX_DEPTH, MAX_FILES = 100_000, 100, 200

# Elements without which nothing in a model can move; files and models that are brought in may hold bodies.
_WITH_BODIES = ("worldbody//body", "worldbody//composite", "worldbody//flexcomp", "include", "attach")
_ASSETS = ("mesh", "texture", "hfield", "skin", "flexcomp", "composite", "plugin")


@raised_as(RobotError)
def scan_mjcf(path: Path) -> None:
    """Refuse a MuJoCo model that would be too large, includes what is no file, or holds numbers that are none.

    Raises:
        RobotError: names file, element and what to do.
    """
    # Each file with those that bring it in, which end in it.
    waiting: list[tuple[Path, ...]] = [(path,)]
    folders, assets = {""}, list[tuple[str, str]]()
    for number, files in enumerate(waiting):
        if number == MAX_FILES:
            what = f"is made of more than {MAX_FILES} files"
            raise robot_error(files[-1], None, what, "reduce what it includes")
        root = read_xml(files[-1], max_depth=MAX_DEPTH)
        if not number:
            _check_whole(root, path)
        _count_elements(root, files[-1])
        for element in root.iter():
            tag = element.tag
            if tag == "include" or (tag == "model" and "file" in element.attrib):
                waiting.append((*files, _brought_in(element, files)))
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
    """How many elements an element becomes, of its own file; what is in it is checked on the way."""
    _check_numbers(element, path)
    tag, repeats = element.tag, element.tag in ("replicate", "composite", "flexcomp")
    total = 1 + sum(_count_elements(child, path) for child in element)
    for part in element.get("count", "1").split() if repeats else ():
        if not re.fullmatch(r"[+-]?\d+", part, re.ASCII):
            what = f"is {shorten_text(element.get('count', ''))!r}"
            raise robot_error(path, f"{tag}@count", what, "give whole numbers")
        # Negative ones are MuJoCo's to refuse; more digits than Python reads are too many anyway.
        total *= max(1, int(part[:20]))
    if total > MAX_EXPANDED:
        what = f"stands for more than {MAX_EXPANDED} elements"
        raise robot_error(path, f"{tag}@count" if repeats else tag, what, "repeat less")
    return total


def _brought_in(element: Element, files: tuple[Path, ...]) -> Path:
    """The file that an element brings into the last of some, each of which is brought into by the one before.

    MuJoCo takes its name relative to the first, other tools to the one that names it.
    """
    named, place = element.get("file", ""), f"{element.tag}@file"
    if not named:
        raise robot_error(files[-1], place, "is missing", "name it")
    places = [file.parent / named for file in (files[0], files[-1])]
    other = next((one for one in places if os.path.exists(one)), places[0])
    if os.path.exists(other) and any(other.samefile(file) for file in files):
        raise robot_error(files[-1], place, f"includes itself through {named!r}", "remove it")
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


# Numbers in the attributes of a MuJoCo model: finite, of a size that something has, and counts that end.

# Attributes that hold words, which may look like numbers.
_WORDS = frozenset(
    "name class childclass model file prefix plugin instance key value "
    "joint joint1 joint2 body body1 body2 geom geom1 geom2 site site1 site2 "
    "mesh material texture hfield tendon tendon1 tendon2 actuator sensor target "
    "objname refname reftype objtype jointinparent sidesite refsite cranksite slidersite "
    "flex skin content_type dclass gridlayout quat_order eulerseq ".split()
)
# Attributes and elements, all where none are named, the largest number there, and what to do about a larger one.
_LARGEST: tuple[tuple[set[str], set[str], float, str], ...] = (
    # Buffers of a humanoid in a crowd have some thousands; each of these reserves memory for every one.
    (set(), {"size"}, 1e6, "reserve less"),
    # A picture or a height field of so many points a side has 200 MB.
    ({"nrow", "ncol", "width", "height"}, {"hfield", "texture"}, 8192, "reduce its size"),
    ({"mass", "settotalmass", "boundmass"}, set(), MAX_MASS, "write kilograms"),
    # Joints are locked by a damping of 1e11 in models that are made for learning.
    ({"damping"}, {"joint"}, 1e15, "leave the joint out, where it shall not move"),
    # Osmium has 22 600 kg/m³; a density a hundredfold is a slip of unit.
    ({"density"}, set(), 1e6, "write kg/m³"),
    # Gains of 1e5 and stand-ins for "no limit" of 1e6 occur; MuJoCo itself takes 1e10 for the end of all numbers.
    (set(), set(), 1e10, "check its unit and exponent"),
)
_NOT_FINITE = re.compile(r"(?<![\w.])[+-]?(nan|inf|infinity)(?![\w.])", re.IGNORECASE)
_MEMORY = re.compile(r"(-?\d+)\s*([kmgtpe]?)", re.ASCII)
_MAX_MEMORY_BYTES = 4e9


def _check_numbers(element: Element, path: Path) -> None:
    """Refuse an element whose attributes hold numbers that are none, or that no model has; raises RobotError."""
    called = f" {shorten_text(element.get('name', ''))!r}" if element.get("name") else ""
    for name, text in element.items():
        where, memory = f"{element.tag}{called}@{name}", _MEMORY.fullmatch(text.strip().lower())
        if name == "memory" and memory:
            if float(memory[1]) * 1024.0 ** " kmgtpe".index(memory[2] or " ") > _MAX_MEMORY_BYTES:
                what = f"is {shorten_text(text)!r}, more than {_MAX_MEMORY_BYTES:g} bytes"
                raise robot_error(path, where, what, "leave it out; MuJoCo sizes it")
        elif name not in _WORDS:
            _check_attribute(element, name, text, path, where)


def _check_attribute(element: Element, name: str, text: str, path: Path, where: str) -> None:
    said = f"is {shorten_text(text)!r}"
    if _NOT_FINITE.search(text):
        raise robot_error(path, where, said, "give finite numbers")
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
        if not part.isascii():
            raise robot_error(path, where, said, "write it with the digits 0 to 9")
        if not abs(value) <= most:
            raise robot_error(path, where, f"{said}, more than any model has ({most:g})", cause)
        if name in {"mass", "density"} and value < 0.0 and element.tag != "compiler":
            raise robot_error(path, where, f"is {part}", "give a positive number")


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
