"""Shapes of a link as its URDF gives them: boxes, spheres, cylinders, capsules, and hulls of meshes."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from hashlib import blake2b
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.cache import cached_file, read_cached, write_cached
from excite.errors import RobotError
from excite.robot.links import link_placement
from excite.robot.quantities import MAX_TRAVEL
from excite.robot.robot import Robot
from excite.robot.shapes import meshes
from excite.robot.shapes.meshes import Hull, convex_hull
from excite.robot.shapes.shape import Shape
from excite.threads import blas_kernels

# A hull of 96 corners may have to grow by a hundredth; of a smooth body the growth falls with the corners' square.
_CORNERS, _SLACK = 96, 0.01


def links_by_kind(
    links: Sequence[ElementTree.Element], geometry: str
) -> dict[str, list[ElementTree.Element]]:
    """Links by the kind of element that gives them shape.

    Of ``either`` it is ``visual`` where they have no ``collision`` whose files are there, if its own are: pictures are
    left out of many copies of a model.
    """
    if geometry != "either":
        return {geometry: list(links)}
    kinds: dict[str, list[ElementTree.Element]] = {"collision": [], "visual": []}
    for link in links:
        solid = link.find("collision") is not None
        if solid and _is_there(link, "collision"):
            kinds["collision"].append(link)
        elif _is_there(link, "visual") and (not solid or link.find("visual") is not None):
            kinds["visual"].append(link)
        elif solid:
            kinds["collision"].append(link)
    return kinds


def _is_there(link: ElementTree.Element, kind: str) -> bool:
    return all(Path(mesh.get("filename", "")).is_file() for mesh in link.iterfind(f"{kind}/geometry/mesh"))


def link_shapes(
    robot: Robot, link: ElementTree.Element, kind: str, meshes: Mapping[Path, Array], *, partial: bool = False
) -> list[Shape]:
    """Shapes of a link from its elements of a kind (``collision`` or ``visual``).

    Args:
        robot: whose link.
        link: its element.
        kind: of its elements.
        meshes: corners of mesh files.
        partial: whether meshes that are not among these, or are flat, are passed over.

    Raises:
        RobotError: an element is no solid.
    """
    name = link.get("name", "")
    shapes = []
    for number, element in enumerate(link.findall(kind)):
        where = f"link {name!r}, {kind} {number}"
        joint, placement = link_placement(robot.model, name, robot.source, where)
        pose = placement * origin_of(element.find("origin"))
        geometry = element.find("geometry")
        solid = geometry[0] if geometry is not None and len(geometry) else None
        if solid is None:
            raise RobotError(
                "has no geometry", source=robot.source, field=where, remedy="remove or fill the element"
            )
        points = meshes.get(Path(solid.get("filename", ""))) if solid.tag == "mesh" else None
        if partial and points is None and solid.tag == "mesh":
            continue
        corners = robot.description.collision.hull_corners
        try:
            shape = solid_shape(solid, points, robot.source, where, corners)
        except RobotError:
            if partial:
                continue
            raise
        shapes.append(replace(shape, name=f"{name}_{number}", link=name, joint=joint, placement=pose))
    return shapes


def solid_shape(
    solid: ElementTree.Element, points: Array | None, source: Path, where: str, corners: int = _CORNERS
) -> Shape:
    """The solid of a ``geometry`` element in its own frame, of no link yet.

    Args:
        solid: the element in ``geometry``.
        points: corners of its mesh ``(n, 3)`` in the file's own unit; None of anything else.
        source: the URDF, for the error.
        where: place in it, in words.
        corners: most corners of a mesh's hull.

    Raises:
        RobotError: it is no solid.
    """
    nowhere = ("", "", 0, pin.SE3.Identity())
    if solid.tag == "mesh" and points is not None:
        points = points * numbers_of(solid.get("scale", "1 1 1"))
        if np.abs(points).max() > MAX_TRAVEL:
            raise RobotError(
                f"its mesh reaches {np.abs(points).max():.3g} m from its origin",
                source=source,
                field=where,
                remedy='looks like millimetres: write scale="0.001 0.001 0.001"',
            )
        try:
            hull = kept_hull(points, corners, _SLACK * (_CORNERS / corners) ** 2)
        except ValueError as error:
            raise RobotError(
                str(error), source=source, field=where, remedy="author a shape instead"
            ) from error
        return Shape(*nowhere, "convex", (), hull.vertices, hull.faces)
    if solid.tag == "box":
        return Shape(*nowhere, "box", tuple(numbers_of(solid.get("size", "")).tolist()))
    if solid.tag == "sphere":
        return Shape(*nowhere, "sphere", (float(solid.get("radius", "nan")),))
    if solid.tag in {"cylinder", "capsule"}:
        size = (float(solid.get("radius", "nan")), float(solid.get("length", "nan")))
        return Shape(*nowhere, "capsule" if solid.tag == "capsule" else "cylinder", size)
    raise RobotError(
        f"unknown geometry {solid.tag!r}",
        source=source,
        field=where,
        remedy="use a mesh, box or sphere",
    )


def origin_of(origin: ElementTree.Element | None) -> pin.SE3:
    """Placement that an ``<origin>`` states, none if there is no such element."""
    if origin is None:
        return pin.SE3.Identity()
    return pin.SE3(
        pin.rpy.rpyToMatrix(*numbers_of(origin.get("rpy", "0 0 0"))), numbers_of(origin.get("xyz", "0 0 0"))
    )


def numbers_of(text: str) -> Array:
    """Numbers of an attribute."""
    return np.array([float(part) for part in text.split()])


# Hulls kept on disk between processes, so that a humanoid's are computed once a machine and not once a
# command.


def kept_hull(points: Array, max_vertices: int, slack: float) -> Hull:
    """What :func:`~excite.robot.shapes.meshes.convex_hull` returns, to the bit, from disk where it was computed before.

    It is kept under a digest of the points, the numbers, and all that decides how they are rounded: the code, numpy,
    scipy and the machine's kernels of linear algebra. Where it is kept says :mod:`excite.cache`.

    Args:
        points: ``(n, 3)`` [m].
        max_vertices: most corners that the result may have, at least 32.
        slack: growth below which no more corners are added.

    Raises:
        ValueError: the points lie in a plane.
    """
    settings = f"{_rounding_key()} {max_vertices} {slack!r} {points.shape}".encode()
    file = cached_file("hulls", settings, points.tobytes())
    hull = _parse_hull(read_cached(file))
    if hull is None:
        hull = convex_hull(points, max_vertices, slack)
        write_cached(file, _render_hull(hull))
    return hull


@cache
def _rounding_key() -> str:
    """What the same points may have another hull with."""
    code = blake2b(Path(meshes.__file__).read_bytes()).hexdigest()
    import scipy

    return f"{code} {np.__version__} {scipy.__version__} {blas_kernels()}"


def _parse_hull(content: bytes | None) -> Hull | None:
    """A hull as :func:`_render_hull` wrote it."""
    if content is None:
        return None
    with np.load(io.BytesIO(content), allow_pickle=False) as parts:
        return Hull(parts["vertices"], parts["faces"], float(parts["inflation"]))


def _render_hull(hull: Hull) -> bytes:
    parts = io.BytesIO()
    np.savez(parts, vertices=hull.vertices, faces=hull.faces, inflation=hull.inflation)
    return parts.getvalue()
