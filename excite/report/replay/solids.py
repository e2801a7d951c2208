"""Boxes, balls, cylinders and capsules as triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array

# Corners around: a cylinder's edge stays within 3 % of its radius.
_AROUND = 14
_RINGS = 3
# Of a box whose corners count up in binary, x first: two triangles a side, anticlockwise from outside.
_SIDES = np.array(
    [
        *[[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5]],
        *[[0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]],
        *[[0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]],
    ]
)


def solid_triangles(kind: str, size: tuple[float, ...]) -> tuple[Array, NDArray[np.int64]]:
    """Corners ``(n, 3)`` [m] and triangles ``(m, 3)`` of a solid in its own frame, anticlockwise from outside.

    Args:
        kind: ``box``, ``sphere``, ``cylinder`` or ``capsule``; anything else has none.
        size: as of :class:`~excite.robot.shapes.shape.Shape`.
    """
    if kind == "box":
        corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        return corners * np.array(size), _SIDES
    if kind not in {"sphere", "cylinder", "capsule"}:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    radius, half = size[0], 0.5 * size[1] if kind != "sphere" else 0.0
    if kind == "cylinder":
        return _turned_body([(-half, radius), (half, radius)], (-half, half))
    rise = np.linspace(0.0, 0.5 * np.pi, _RINGS, endpoint=False)
    upper = [(half + radius * float(np.sin(t)), radius * float(np.cos(t))) for t in rise]
    lower = [(-height, width) for height, width in reversed(upper)]
    # A ball's two halves share their equator.
    return _turned_body(lower + upper[kind == "sphere" :], (-half - radius, half + radius))


def _turned_body(
    rings: list[tuple[float, float]], poles: tuple[float, float]
) -> tuple[Array, NDArray[np.int64]]:
    """A body turned about z, of rings (height, radius) from below and the heights of its lowest and highest point."""
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    levels = [np.column_stack([radius * circle, np.full(_AROUND, height)]) for height, radius in rings]
    corners = np.vstack([*levels, [[0.0, 0.0, poles[0]], [0.0, 0.0, poles[1]]]])
    here, bottom = np.arange(_AROUND), len(corners) - 2
    after, last = np.roll(here, -1), (len(rings) - 1) * _AROUND
    triangles = [np.column_stack([np.full(_AROUND, bottom), after, here])]
    for below in range(0, last, _AROUND):
        above = below + _AROUND
        triangles.append(np.column_stack([below + here, below + after, above + after]))
        triangles.append(np.column_stack([below + here, above + after, above + here]))
    triangles.append(np.column_stack([last + here, last + after, np.full(_AROUND, bottom + 1)]))
    return corners, np.vstack(triangles)
