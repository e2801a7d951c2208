"""Boxes, balls, cylinders and capsules as triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array

# Corners around: a cylinder's edge stays within 3 % of its radius.
_AROUND = 14
_RINGS = 3


def solid_triangles(kind: str, size: tuple[float, ...]) -> tuple[Array, NDArray[np.int64]]:
    """Corners ``(n, 3)`` [m] and triangles ``(m, 3)`` of a solid in its own frame, anticlockwise from outside.

    Args:
        kind: ``box``, ``sphere``, ``cylinder`` or ``capsule``; anything else has none.
        size: as of :class:`~excite.robot.shapes.shape.Shape`.
    """
    if kind == "box":
        corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        return _hull(corners * np.array(size))
    if kind not in {"sphere", "cylinder", "capsule"}:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    radius, half = size[0], 0.5 * size[1] if kind != "sphere" else 0.0
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    circle = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(_AROUND)])
    if kind == "cylinder":
        return _hull(np.vstack([radius * circle + np.array([0.0, 0.0, end]) for end in (-half, half)]))
    rise = np.linspace(0.0, 0.5 * np.pi, _RINGS, endpoint=False)
    dome = np.vstack([radius * (np.cos(t) * circle + np.array([0.0, 0.0, np.sin(t)])) for t in rise])
    dome = np.vstack([dome, [[0.0, 0.0, radius]]])
    up = dome + np.array([0.0, 0.0, half])
    return _hull(np.vstack([up, up * np.array([1.0, 1.0, -1.0])]))


def _hull(corners: Array) -> tuple[Array, NDArray[np.int64]]:
    from scipy.spatial import ConvexHull

    hull = ConvexHull(corners)
    triangles = hull.simplices.astype(np.int64)
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    triangles[inward] = triangles[inward][:, [0, 2, 1]]
    return corners, triangles
