"""Collision and visual geometry of a URDF: places and sizes that something can have."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from excite.errors import RobotError
from excite.robot.urdf.numbers import read_numbers

# Attributes of solids that are lengths or factors, how many numbers each holds, and its default.
_LENGTHS: dict[str, tuple[tuple[str, int, str | None], ...]] = {
    "box": (("size", 3, None),),
    "sphere": (("radius", 1, None),),
    "cylinder": (("radius", 1, None), ("length", 1, None)),
    "capsule": (("radius", 1, None), ("length", 1, None)),
    "mesh": (("scale", 3, "1 1 1"),),
}


def check_origin(element: ElementTree.Element, where: str, path: Path) -> None:
    """Raise RobotError unless the element's ``origin``, if it has one, holds positions and angles."""
    origin = element.find("origin")
    if origin is not None:
        for attribute in ("xyz", "rpy"):
            read_numbers(origin, attribute, 3, path, f"{where}/origin", default="0 0 0")


def check_geometry(link: ElementTree.Element, name: str, path: Path) -> None:
    """Raise RobotError unless the solids of a link have places and sizes."""
    for kind in ("collision", "visual"):
        for number, element in enumerate(link.findall(kind)):
            where = f"link {name!r}/{kind} {number}"
            check_origin(element, where, path)
            for solid in element.iterfind("geometry/*"):
                _check_solid(solid, where, path)


def drop_points(root: ElementTree.Element) -> None:
    """Take out solids all of whose lengths are zero, which stand for none in many models: they take no room.

    A link that is left without geometry is named where a first description says what nothing checks.
    """
    for link in root.findall("link"):
        for kind in ("collision", "visual"):
            for element in link.findall(kind):
                if any(_is_point(solid) for solid in element.iterfind("geometry/*")):
                    link.remove(element)


def _is_point(solid: ElementTree.Element) -> bool:
    lengths = " ".join(solid.get(attribute, "none") for attribute, _, _ in _LENGTHS.get(solid.tag, ()))
    try:
        return solid.tag != "mesh" and lengths != "" and not any(float(length) for length in lengths.split())
    except ValueError:
        return False


def _check_solid(solid: ElementTree.Element, where: str, path: Path) -> None:
    where = f"{where}/{solid.tag}"
    if solid.tag == "mesh" and not solid.get("filename", "").strip():
        raise RobotError("is missing", source=path, field=f"{where}@filename", remedy="name the mesh file")
    for attribute, count, default in _LENGTHS.get(solid.tag, ()):
        values = read_numbers(solid, attribute, count, path, where, default=default)
        # A mesh may be mirrored by a negative scale, and scaled to nothing by none.
        if any(value == 0.0 if solid.tag == "mesh" else value <= 0.0 for value in values):
            what = f"is {solid.get(attribute)!r}"
            raise RobotError(what, source=path, field=f"{where}@{attribute}", remedy="give lengths above 0")
