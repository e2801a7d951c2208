"""The 10 242 vectors of eq. (13) of Jovic et al. 2016."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array


@cache
def icosphere_corners(subdivisions: int) -> Array:
    """Corners of an icosahedron whose faces are split in four ``subdivisions`` times, on the unit sphere.

    Returns:
        ``(10·4ⁿ + 2, 3)``; read only.
    """
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    corners = [(s, t * golden, 0.0) for s in (-1.0, 1.0) for t in (-1.0, 1.0)]
    corners = corners + [(0.0, a, b) for a, b, _ in corners] + [(b, 0.0, a) for a, b, _ in corners]
    points = np.array(corners) / np.sqrt(1.0 + golden**2)
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = np.isclose(distance, np.sort(distance[0])[1])
    faces = np.array(
        [
            (i, j, k)
            for i in range(12)
            for j in range(i + 1, 12)
            for k in range(j + 1, 12)
            if near[i, j] and near[j, k] and near[i, k]
        ]
    )
    for _ in range(subdivisions):
        points, faces = _split_faces(points, faces)
    points.setflags(write=False)
    return np.asarray(points)


def _split_faces(points: Array, faces: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    edges = np.sort(np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, index = np.unique(edges, axis=0, return_inverse=True)
    middle = points[unique].sum(axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    ab, bc, ca = (index.reshape(3, -1) + len(points)).astype(np.int64)
    a, b, c = faces.T
    corners = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    return np.vstack([points, middle]), np.vstack([np.column_stack(face) for face in corners])
