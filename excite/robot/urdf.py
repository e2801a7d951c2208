"""Strict reading of URDF files: what is missing or absurd is one clear error before pinocchio sees it."""

from __future__ import annotations

import os
from pathlib import Path
from xml.etree import ElementTree

from defusedxml.ElementTree import fromstring

from excite.errors import RobotError


def read_urdf(path: Path) -> str:
    """Read a URDF, check it and make its mesh paths absolute.

    Args:
        path: the URDF file.

    Returns:
        URDF text that pinocchio can load.

    Raises:
        RobotError: the file is missing or something in it is absurd; names element and remedy.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RobotError(f"cannot be read ({error})", source=path, remedy="check the path") from error
    root = fromstring(content)
    _absolute_meshes(root, path)
    return ElementTree.tostring(root, encoding="unicode")


def _absolute_meshes(root: ElementTree.Element, path: Path) -> None:
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        found = find_mesh(name, path)
        if found is not None:
            mesh.set("filename", str(found))


def find_mesh(name: str, urdf: Path) -> Path | None:
    """File that a mesh's ``filename`` means, or None if there is none.

    ``package://NAME/…`` is looked for in the folders above the URDF and in ``$ROS_PACKAGE_PATH``;
    other names are relative to the URDF.
    """
    folder = urdf.resolve().parent
    if not name.startswith("package://"):
        file = folder / name.removeprefix("file://")
        return file.resolve() if name and file.is_file() else None
    relative = Path(name.removeprefix("package://").lstrip("/"))
    roots = [folder, *folder.parents]
    roots += [Path(entry) for entry in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if entry]
    for root in roots:
        file = root / relative
        if file.is_file():
            return file.resolve()
        # The package's folder may have another name in a checkout.
        file = root.joinpath(*relative.parts[1:])
        if root.name == relative.parts[0] and file.is_file():
            return file.resolve()
    return None
