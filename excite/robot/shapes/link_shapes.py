"""Shapes of a link as its URDF gives them: boxes, spheres, cylinders, capsules, and hulls of meshes."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from hashlib import blake2b
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from excite.arrays import Array, Indices
from excite.cache import cached_file, read_cached, write_cached
from excite.errors import RobotError
from excite.robot.links import link_placement
from excite.robot.quantities import MAX_TRAVEL
from excite.robot.refusal import robot_error
from excite.robot.robot import Robot
from excite.robot.shapes.shape import Kind, Shape
from excite.robot.urdf.inertia import LENGTHS
from excite.robot.urdf.numbers import read_origin
from excite.threads import blas_kernels

# A hull of 96 corners may have to grow by a hundredth; of a smooth body the growth falls with the corners' square.
_CORNERS, _SLACK = 96, 0.01
_PRIMITIVES: dict[str, Kind] = {
    "box": "box",
    "sphere": "sphere",
    "cylinder": "cylinder",
    "capsule": "capsule",
}


def links_by_kind(links: Sequence[Element], geometry: str) -> dict[str, list[Element]]:
    """Links by the kind of element that gives them shape.

    Of ``either`` it is ``visual`` where they have no ``collision`` whose files are there, if its own are: pictures are
    left out of many copies of a model.
    """
    if geometry != "either":
        return {geometry: list(links)}
    kinds: dict[str, list[Element]] = {"collision": [], "visual": []}
    for link in links:
        solid = link.find("collision") is not None
        if solid and _is_there(link, "collision"):
            kinds["collision"].append(link)
        elif _is_there(link, "visual") and (not solid or link.find("visual") is not None):
            kinds["visual"].append(link)
        elif solid:
            kinds["collision"].append(link)
    return kinds


def _is_there(link: Element, kind: str) -> bool:
    return all(Path(mesh.get("filename", "")).is_file() for mesh in link.iterfind(f"{kind}/geometry/mesh"))


def link_shapes(
    robot: Robot, link: Element, kind: str, meshes: Mapping[Path, Array], *, partial: bool = False
) -> list[Shape]:
    """Shapes of a link from its elements of a kind (``collision`` or ``visual``).

    Args:
        kind: of its elements.
        meshes: corners of mesh files.
        partial: whether meshes that are not among these, or are flat, are passed over.

    Raises:
        RobotError: an element is no solid.
    """
    name, corners, shapes = link.get("name", ""), robot.description.collision.hull_corners, []
    for number, element in enumerate(link.findall(kind)):
        where = f"link {name!r}, {kind} {number}"
        joint, placement = link_placement(robot.model, name, robot.source, where)
        pose, solid = (
            placement * read_origin(element),
            next(element.iterfind("geometry/*"), None),
        )
        if solid is None:
            raise robot_error(robot.source, where, "has no geometry", "remove or fill the element")
        points = meshes.get(Path(solid.get("filename", ""))) if solid.tag == "mesh" else None
        if partial and points is None and solid.tag == "mesh":
            continue
        try:
            shape = solid_shape(solid, points, robot.source, where, corners)
        except RobotError:
            if partial:
                continue
            raise
        shapes.append(replace(shape, name=f"{name}_{number}", link=name, joint=joint, placement=pose))
    return shapes


def solid_shape(
    solid: Element, points: Array | None, source: Path, where: str, corners: int = _CORNERS
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
            what = f"its mesh reaches {np.abs(points).max():.3g} m from its origin"
            remedy = 'looks like millimetres: write scale="0.001 0.001 0.001"'
            raise robot_error(source, where, what, remedy)
        try:
            vertices, faces = kept_hull(points, corners, _SLACK * (_CORNERS / corners) ** 2)
        except ValueError as error:
            raise robot_error(source, where, str(error), "author a shape instead") from error
        return Shape(*nowhere, "convex", (), vertices, faces)
    if solid.tag not in _PRIMITIVES:
        raise robot_error(source, where, f"unknown geometry {solid.tag!r}", "use a mesh, box or sphere")
    lengths = (solid.get(attribute, "nan") for attribute, _, _ in LENGTHS[solid.tag])
    return Shape(*nowhere, _PRIMITIVES[solid.tag], tuple(numbers_of(" ".join(lengths)).tolist()))


def numbers_of(text: str) -> Array:
    """Numbers of an attribute."""
    return np.array([float(part) for part in text.split()])


# Hulls kept on disk between processes, so that a humanoid's are computed once a machine and not once a
# command.


def kept_hull(points: Array, max_vertices: int, slack: float) -> Hull:
    """What :func:`convex_hull` returns, to the bit, from disk where it was computed before.

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
    content, kept = read_cached(file), io.BytesIO()
    if content is not None:
        with np.load(io.BytesIO(content), allow_pickle=False) as parts:
            return parts["vertices"], parts["faces"]
    hull = convex_hull(points, max_vertices, slack)
    np.savez(kept, vertices=hull[0], faces=hull[1])
    write_cached(file, kept.getvalue())
    return hull


@cache
def _rounding_key() -> str:
    """What the same points may have another hull with."""
    code = blake2b(Path(__file__).read_bytes()).hexdigest()
    import scipy

    return f"{code} {np.__version__} {scipy.__version__} {blas_kernels()}"


# Meshes as convex hulls of few vertices that contain the mesh.

Hull = tuple[Array, Indices]
"""Corners of a convex polyhedron, ``(n, 3)`` [m], and its triangles, ``(m, 3)`` rows of corners' indices, anticlockwise
seen from outside."""


def convex_hull(points: Array, max_vertices: int = 96, slack: float = 0.01) -> Hull:
    """A convex polyhedron of few corners that contains all ``points``.

    Corners of the exact hull are added where the polyhedron so far falls short of the points, measured
    as the factor by which it would have to grow about its centre (affine-invariant, so a thin part is
    treated like a thick one). It stops at ``max_vertices`` or when that factor is below ``1 + slack``;
    then the polyhedron is stretched along its principal axes, along the longest as little as can be, until
    it contains every point: it is never smaller than the mesh.

    Args:
        points: ``(n, 3)`` [m].
        max_vertices: most corners that the result may have, at least 32.
        slack: growth below which no more corners are added.

    Raises:
        ValueError: the points lie in a plane.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        exact = ConvexHull(points)
    except QhullError as error:
        raise ValueError("the points lie in a plane and have no convex hull") from error
    corners = points[exact.vertices]
    centre = corners.mean(axis=0)
    axes = np.linalg.svd(corners - centre, full_matrices=False)[2]
    corners = (corners - centre) @ axes.T
    if len(corners) <= max_vertices:
        return _build_polyhedron(corners, np.ones(3), axes, centre)
    # Indices of the corners farthest along axes and diagonals, at most 28, not all in one plane.
    directions = np.array(
        [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z]
    )
    index = np.unique((corners / np.ptp(corners, axis=0) @ directions.T).argmax(axis=0))
    flattest = np.linalg.svd(corners[index] - corners[index].mean(axis=0))[2][2]
    heights = corners @ flattest
    chosen = np.union1d(index, [heights.argmin(), heights.argmax()])
    # Growth is about a point inside the first few corners, hence inside all that follow.
    inside = corners[chosen].mean(axis=0)
    corners, centre = corners - inside, centre + inside @ axes
    while True:
        planes = np.asarray(ConvexHull(corners[chosen]).equations)
        reach = (corners @ planes[:, :3].T) / -planes[:, 3]
        factor = float(reach.max())
        worst = np.argsort(-reach.max(axis=0), kind="stable")[:6]
        new = np.setdiff1d(reach.argmax(axis=0)[worst], chosen)
        if factor <= 1.0 + slack or len(chosen) >= max_vertices or not len(new):
            stretch = _stretch_factors(corners, planes, factor)
            return _build_polyhedron(corners[chosen], stretch, axes, centre)
        chosen = np.union1d(chosen, new[: max_vertices - len(chosen)])


def _stretch_factors(corners: Array, planes: Array, factor: float) -> Array:
    """Growth along each axis, ``(3,)``, after which the polyhedron of ``planes`` contains all corners.

    Growth by ``factor`` along all axes suffices; along one axis after the other, the longest first, it is
    reduced as far as the growth along the other two allows.
    """
    stretch = np.full(3, max(1.0, factor) * (1.0 + 1e-9))
    terms = [corners[:, axis, None] * planes[:, axis] for axis in range(3)]
    for axis in range(3):
        one, other = (k for k in range(3) if k != axis)
        room = -planes[:, 3] - (terms[one] / stretch[one] + terms[other] / stretch[other])
        outward = terms[axis] > 0.0
        needed = terms[axis][outward] / room[outward]
        stretch[axis] = max(1.0, float(needed.max(initial=1.0))) * (1.0 + 1e-9)
    return stretch


def _build_polyhedron(corners: Array, stretch: Array, axes: Array, centre: Array) -> Hull:
    points = corners * stretch @ axes + centre
    used, faces = hull_faces(points)
    return points[used], faces


def hull_faces(points: Array) -> tuple[Indices, Indices]:
    """Which points ``(n, 3)`` are corners of their convex hull, and its triangles as a :data:`Hull` has them."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    used = np.sort(hull.vertices)
    faces = np.searchsorted(used, hull.simplices).astype(np.int64)
    a, b, c = points[used][faces].transpose(1, 0, 2)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, [0, 2, 1]]
    return used, faces
