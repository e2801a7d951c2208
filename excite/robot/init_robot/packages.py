"""Packages of ROS and MoveIt as folders: where one lies, the model in it, pairs of links that may touch."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path

from excite.errors import InputError, RobotError, raised_as
from excite.formats.documents import read_xml, read_yaml
from excite.robot.catalogue import find_robot, is_package
from excite.robot.init_robot.source import Source
from excite.robot.refusal import robot_error

# Folders of ROS packages: those called so, and those whose ``package.xml`` says the name.

_MANIFEST = "package.xml"


def package_folder(name: str, package_path: Iterable[Path], above: Iterable[Path] = ()) -> Path | None:
    """The folder of a package, or None.

    What a ``package.xml`` says goes first, as ROS goes by it: a clone may be called as its owner likes, and a folder
    of that name further up may be anything. Packages elsewhere in the clone that the file lies in are looked at too, as
    of an arm's maker whose torso is another package. Then come folders called so, which say no other name.

    Args:
        package_path: packages, or folders in which packages lie.
        above: folders above the file that needs it, the nearest first, of which each may be the package, or hold it
            under its name.
    """
    given, outer = tuple(package_path), tuple(above)
    near, far = (
        [
            place
            for folder in folders
            for place in (folder, folder / name)
            if place.name == name and place.is_dir()
        ]
        for folders in (given, outer)
    )
    clone = [folder for folder in outer if (folder / ".git").exists()][:1]
    # How far below a folder of packages they are looked for: a workspace holds src, clones, and packages in each of
    # these.
    inside = (place for folder in (*given, *clone) for place in _find_packages(folder, 3))
    # Folders, and whether they must say the name or may say none.
    order = ((chain(near, far, outer), True), (near, False), (inside, True), (far, False))
    found = (
        place
        for places, said in order
        for place in places
        if _package_name(place) == (name if said else None)
    )
    return next(found, None)


def _package_name(folder: Path) -> str | None:
    """The name in a folder's ``package.xml``; None where there is none that can be read."""
    try:
        file = folder / _MANIFEST
        named = read_xml(file).findtext("name") if file.is_file() else None
    except InputError:
        return None
    return named.strip() if named else None


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


# What a package says of a robot: MoveIt's names the description's package, its pairs that may touch and its limits.

_ASSISTANT = ".setup_assistant"


def find_model(name_or_path: str | Path, source: Source) -> tuple[Path, Source]:
    """The file that a person names, by a bundled robot's name, a folder or a package; and how it is to be read.

    Raises:
        UnknownNameError: neither a file nor a bundled robot.
        RobotError: a file of another kind, or a folder or package without one.
    """
    path = Path(name_or_path)
    return model_of_package(path, source) if is_package(path) else (find_robot(name_or_path), source)


def model_of_package(folder: Path, source: Source) -> tuple[Path, Source]:
    """The model in a package, and how it is to be read: with MoveIt's SRDF and joint limits where they lie there.

    MoveIt's Setup Assistant notes the model's package and file. Without it the model is the only URDF, or else the only
    xacro file, of the folder itself, or of its folders ``config``, ``urdf`` and ``robots``.

    Args:
        folder: the package, as ``*_moveit_config`` or ``*_description``.
        source: how it is to be read as far as a person said; that goes first.

    Raises:
        RobotError: no model is found, or several.
    """
    inside = [place for name in (".", "config", "urdf", "robots") if (place := folder / name).is_dir()]
    srdf = sorted(folder.glob("config/*.srdf"))
    limits = folder / "config" / "joint_limits.yaml"
    source = replace(
        source,
        srdf=source.srdf or (srdf[0] if len(srdf) == 1 else None),
        limits=source.limits or (limits if limits.is_file() else None),
    )
    stated = _stated_model(folder, source)
    if stated is not None:
        return stated, source
    for pattern in ("*.urdf", "*.urdf.xacro", "*.xacro"):
        found = sorted({file for place in inside for file in place.glob(pattern)})
        if len(found) == 1:
            return found[0], source
        if found:
            called = ", ".join(str(file.relative_to(folder)) for file in found[:4])
            raise robot_error(folder, None, f"holds {len(found)} models ({called})", "name one of them")
    raise robot_error(
        folder,
        None,
        "is a folder without a robot.yaml or a model",
        "name the URDF, xacro or MJCF, or the robot.yaml that excite init-robot makes of it",
    )


def _stated_model(folder: Path, source: Source) -> Path | None:
    """The model that MoveIt's Setup Assistant was given; None where it noted none."""
    if not (folder / _ASSISTANT).is_file():
        return None
    noted = read_yaml(folder / _ASSISTANT).get("moveit_setup_assistant_config")
    lower = {str(key).lower(): value for key, value in noted.items()} if isinstance(noted, Mapping) else {}
    urdf = lower.get("urdf")
    package, file = (
        str(urdf.get(key) or "") if isinstance(urdf, Mapping) else "" for key in ("package", "relative_path")
    )
    if not file:
        return None
    # Packages of one workspace lie beside each other.
    above = (folder, *folder.resolve().parents)
    beside = (folder.resolve().parent, *source.package_path)
    place = package_folder(package, beside, above) if package else Path()
    if place is None or not (place / file).is_file():
        what = f"names {file} of the package {package!r}, which is not found"
        raise robot_error(
            folder / _ASSISTANT, "urdf", what, "give --package-path FOLDER, in which it or its clone lies"
        )
    return place / file


# Pairs of links that an SRDF file lets touch.


@raised_as(RobotError)
def read_srdf(path: Path) -> tuple[tuple[str, str], ...]:
    """Pairs that ``disable_collisions`` names.

    Raises:
        RobotError: the file is missing, is no SRDF, or a pair names one link only.
    """
    root = read_xml(path)
    if root.tag != "robot" or root.find("link") is not None:
        raise robot_error(path, root.tag, "is no SRDF", "give the .srdf of a MoveIt configuration")
    pairs = []
    for number, element in enumerate(root.findall("disable_collisions")):
        first, second = element.get("link1"), element.get("link2")
        if not first or not second:
            where = f"disable_collisions {number}"
            raise robot_error(path, where, "names one link only", "give link1 and link2")
        pairs.append((first, second))
    return tuple(pairs)
