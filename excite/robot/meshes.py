"""Meshes as convex hulls: reading their points, and hulls of few vertices that contain the mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from excite.errors import RobotError
from excite.reading.child import in_child
from excite.reading.file import check_file, read_bytes

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

Array = NDArray[np.float64]
Faces = NDArray[np.int64]

MAX_MESH_BYTES = 128 * 1024 * 1024
"""Largest mesh file that is read: four times the largest of 780 published ones, and 2.6 million triangles of STL."""

# Meshes of 29 MB take coal 4 s each.
_SECONDS = 40.0
# A kilometre in millimetres.
_FARTHEST = 1e6
_BINARY_STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@dataclass(frozen=True, eq=False)
class Hull:
    """A convex polyhedron.

    Attributes:
        vertices: corners, ``(n, 3)`` [m].
        faces: triangles as rows of vertex indices, ``(m, 3)``, anticlockwise seen from outside.
        inflation: largest factor by which the polyhedron was stretched so that it contains every point
            that it was built from; 1 for the exact hull.
    """

    vertices: Array
    faces: Faces
    inflation: float


def mesh_points(path: Path) -> Array:
    """Corners of a mesh file, ``(n, 3)``, in its own unit and frame; shared corners may be repeated.

    STL is read here; any other format (Collada, OBJ) goes through coal's loader in a process of its own, since that
    one does not return from some damaged files.

    Raises:
        RobotError: the file is missing, damaged, or holds no finite corner.
    """
    if path.suffix.lower() != ".stl":
        return foreign_points((path,))[path]
    return _usable(_stl_points(read_bytes(path, limit=MAX_MESH_BYTES, error=RobotError), path), path)


def foreign_points(paths: Sequence[Path]) -> dict[Path, Array]:
    """Corners of mesh files that coal has to read, as for :func:`mesh_points`, all in one process."""
    for path in paths:
        check_file(path, limit=MAX_MESH_BYTES, error=RobotError)
    if not paths:
        return {}
    try:
        points = _in_child(paths)
    except RobotError:
        if len(paths) == 1:
            raise
        # Which of them it was is not known.
        points = [_in_child((path,))[0] for path in paths]
    return {path: _usable(found, path) for path, found in zip(paths, points, strict=True)}


def _in_child(paths: Sequence[Path]) -> list[Array]:
    function = "excite.robot.meshes:coal_points"
    return in_child(function, tuple(paths), source=paths[0], error=RobotError, seconds=_SECONDS)


def coal_points(paths: Sequence[Path]) -> list[Array]:
    """Corners of mesh files as coal's loader reads them; run in a child process by :func:`foreign_points`."""
    import coal

    found = []
    for path in paths:
        try:
            found.append(np.array(coal.MeshLoader().load(str(path), np.ones(3)).vertices()))
        except (OSError, ValueError, RuntimeError) as error:
            reason = " ".join(str(error).split())
            raise RobotError(
                f"mesh cannot be read ({reason[:160]})", source=path, remedy="check the mesh's format"
            ) from error
    return found


def _usable(points: Array, path: Path) -> Array:
    if len(points) == 0 or not np.isfinite(points).all():
        raise RobotError(
            "mesh has no corners or one that is not finite", source=path, remedy="export it again"
        )
    if np.abs(points).max() > _FARTHEST:
        raise RobotError(
            f"mesh has a corner at {np.abs(points).max():.3g}",
            source=path,
            remedy="it is damaged: export it again",
        )
    return points


def _stl_points(content: bytes, path: Path) -> Array:
    n_triangles = int.from_bytes(content[80:84], "little") if len(content) >= 84 else -1
    if n_triangles > 0 and len(content) == 84 + 50 * n_triangles:
        triangles = np.frombuffer(content, _BINARY_STL, n_triangles, offset=84)
        return triangles["corners"].reshape(-1, 3).astype(np.float64)
    if b"vertex" not in content:
        raise RobotError(
            f"mesh has {len(content)} bytes and declares {n_triangles} triangles, which need {84 + 50 * n_triangles}"
            if n_triangles >= 0
            else f"mesh has {len(content)} bytes, less than the head of an STL file",
            source=path,
            remedy="it is damaged: export it again",
        )
    try:
        rows = [
            line.split()[1:] for line in content.decode("ascii", "replace").splitlines() if "vertex" in line
        ]
        return np.array(rows, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise RobotError(
            "mesh has a vertex that is not three numbers",
            source=path,
            remedy="it is damaged: export it again",
        ) from error


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
    from scipy.spatial import QhullError

    try:
        exact = _exact_hull(points)
    except (QhullError, ValueError) as error:
        raise ValueError("the points lie in a plane and have no convex hull") from error
    corners = points[exact.vertices]
    centre = corners.mean(axis=0)
    axes = np.linalg.svd(corners - centre, full_matrices=False)[2]
    corners = (corners - centre) @ axes.T
    if len(corners) <= max_vertices:
        return _polyhedron(corners, np.ones(3), axes, centre)
    chosen = _extremes(corners)
    # Growth is about a point inside the first few corners, hence inside all that follow.
    inside = corners[chosen].mean(axis=0)
    corners, centre = corners - inside, centre + inside @ axes
    while True:
        planes = _planes(corners[chosen])
        reach = (corners @ planes[:, :3].T) / -planes[:, 3]
        factor = float(reach.max())
        if factor <= 1.0 + slack or len(chosen) >= max_vertices:
            return _polyhedron(corners[chosen], _stretch(corners, planes, factor), axes, centre)
        worst = np.argsort(-reach.max(axis=0), kind="stable")[:6]
        new = np.setdiff1d(reach.argmax(axis=0)[worst], chosen)
        if len(new) == 0:
            return _polyhedron(corners[chosen], _stretch(corners, planes, factor), axes, centre)
        chosen = np.union1d(chosen, new[: max_vertices - len(chosen)])


def _stretch(corners: Array, planes: Array, factor: float) -> Array:
    """Growth along each axis, ``(3,)``, after which the polyhedron of ``planes`` contains all corners.

    Growth by ``factor`` along all axes suffices; along one axis after the other, the longest first, it is
    reduced as far as the growth along the other two allows.
    """
    stretch = np.full(3, max(1.0, factor) * (1.0 + 1e-9))
    terms = corners[:, None, :] * planes[None, :, :3]
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        room = -planes[:, 3] - (terms[:, :, others] / stretch[others]).sum(axis=2)
        outward = terms[:, :, axis] > 0.0
        needed = terms[:, :, axis][outward] / room[outward]
        stretch[axis] = max(1.0, float(needed.max(initial=1.0))) * (1.0 + 1e-9)
    return stretch


def _extremes(corners: Array) -> Faces:
    """Indices of the corners farthest along axes and diagonals, at most 28, not all in one plane."""
    directions = np.array(
        [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z]
    )
    index = np.unique((corners / np.ptp(corners, axis=0) @ directions.T).argmax(axis=0))
    flattest = np.linalg.svd(corners[index] - corners[index].mean(axis=0))[2][2]
    heights = corners @ flattest
    return np.union1d(index, [heights.argmin(), heights.argmax()])


def _exact_hull(points: Array) -> ConvexHull:
    # Loaded where a hull is made: most commands that read a robot make none.
    from scipy.spatial import ConvexHull

    return ConvexHull(points)


def _planes(corners: Array) -> Array:
    return _exact_hull(corners).equations


def _polyhedron(corners: Array, stretch: Array, axes: Array, centre: Array) -> Hull:
    hull = _exact_hull(corners * stretch @ axes + centre)
    used = np.sort(hull.vertices)
    faces = np.searchsorted(used, hull.simplices).astype(np.int64)
    vertices = hull.points[used]
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, [0, 2, 1]]
    return Hull(vertices, faces, float(stretch.max()))
