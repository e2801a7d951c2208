"""Meshes as convex hulls of few vertices that contain the mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

Faces = NDArray[np.int64]


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
    except QhullError as error:
        raise ValueError("the points lie in a plane and have no convex hull") from error
    corners = points[exact.vertices]
    centre = corners.mean(axis=0)
    axes = np.linalg.svd(corners - centre, full_matrices=False)[2]
    corners = (corners - centre) @ axes.T
    if len(corners) <= max_vertices:
        return _build_polyhedron(corners, np.ones(3), axes, centre)
    chosen = _extreme_corners(corners)
    # Growth is about a point inside the first few corners, hence inside all that follow.
    inside = corners[chosen].mean(axis=0)
    corners, centre = corners - inside, centre + inside @ axes
    while True:
        planes = _hull_planes(corners[chosen])
        reach = (corners @ planes[:, :3].T) / -planes[:, 3]
        factor = float(reach.max())
        if factor <= 1.0 + slack or len(chosen) >= max_vertices:
            return _build_polyhedron(corners[chosen], _stretch_factors(corners, planes, factor), axes, centre)
        worst = np.argsort(-reach.max(axis=0), kind="stable")[:6]
        new = np.setdiff1d(reach.argmax(axis=0)[worst], chosen)
        if len(new) == 0:
            return _build_polyhedron(corners[chosen], _stretch_factors(corners, planes, factor), axes, centre)
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


def _extreme_corners(corners: Array) -> Faces:
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


def _hull_planes(corners: Array) -> Array:
    return np.asarray(_exact_hull(corners).equations)


def _build_polyhedron(corners: Array, stretch: Array, axes: Array, centre: Array) -> Hull:
    hull = _exact_hull(corners * stretch @ axes + centre)
    used = np.sort(hull.vertices)
    faces = np.searchsorted(used, hull.simplices).astype(np.int64)
    vertices = hull.points[used]
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, [0, 2, 1]]
    return Hull(vertices, faces, float(stretch.max()))
