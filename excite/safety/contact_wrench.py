"""The wrench that a motion asks of the ground, and where it acts.

Everything here takes arrays over samples, in the world frame with z up, and knows no robot.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Samples that are worked on at a time, to bound memory.
_BLOCK = 1024


def wrench_at_world_origin(base_wrench: Array, rotation: Array, position: Array) -> Array:
    """Move the generalised force of a free base to the world.

    The first six rows of inverse dynamics without contacts are the wrench that contacts must supply
    (Jovic et al. 2016, eq. 2: the base rows contain no joint torque).

    Args:
        base_wrench: ``(n, 6)`` force, then moment about the base origin, base frame [N, N·m].
        rotation: ``(n, 3, 3)`` base frame in the world.
        position: ``(n, 3)`` base origin in the world [m].

    Returns:
        ``(n, 6)`` force, then moment about the world origin, world frame [N, N·m].
    """
    force = np.einsum("nij,nj->ni", rotation, base_wrench[:, :3])
    moment = np.einsum("nij,nj->ni", rotation, base_wrench[:, 3:])
    return np.hstack([force, moment + np.cross(position, force)])


def zero_moment_point(wrench: Array, height: float = 0.0) -> Array:
    """Point on level ground about which a contact wrench has no horizontal moment.

    ``p_x = (h·f_x − m_y)/f_z``, ``p_y = (h·f_y + m_x)/f_z`` (Vukobratović and Borovac 2004).

    Args:
        wrench: ``(n, 6)`` force, then moment about the world origin, world frame [N, N·m].
        height: of the ground [m].

    Returns:
        ``(n, 2)`` x and y [m]; NaN where the ground would have to pull (``f_z ≤ 0``).
    """
    vertical = np.where(wrench[:, 2] > 0.0, wrench[:, 2], np.nan)
    x = (height * wrench[:, 0] - wrench[:, 4]) / vertical
    y = (height * wrench[:, 1] + wrench[:, 3]) / vertical
    return np.column_stack([x, y])


def polygon_margin(corners: Array, points: Array) -> Array:
    """Signed distance of points from the edge of the convex hull of corners, one hull a sample.

    A directed line through two corners is an edge if no corner lies to its right; the margin is the smallest
    distance to the left of an edge. Outside it is minus the largest distance beyond an edge's line, which is
    at most the distance to the polygon.

    Args:
        corners: ``(n, m, 2)`` [m].
        points: ``(n, 2)`` [m].

    Returns:
        ``(n,)`` [m]: positive inside, negative outside, NaN where a point is NaN or the hull has no area.
    """
    margin = np.empty(len(points))
    for start in range(0, len(points), _BLOCK):
        block = slice(start, start + _BLOCK)
        margin[block] = _polygon_margin(corners[block], points[block])
    return margin


def _polygon_margin(corners: Array, points: Array) -> Array:
    if corners.shape[1] < 3:
        return np.full(len(points), np.nan)
    start, end = np.triu_indices(corners.shape[1], 1)
    edge = corners[:, end] - corners[:, start]
    length = np.linalg.norm(edge, axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        along_x, along_y = edge[..., 0] / length, edge[..., 1] / length
    # Distance to the left of each directed line, of every corner and of the point.
    offset = along_x * corners[:, start, 1] - along_y * corners[:, start, 0]
    left = along_x[..., None] * corners[:, None, :, 1] - along_y[..., None] * corners[:, None, :, 0]
    left -= offset[..., None]
    distance = along_x * points[:, 1, None] - along_y * points[:, 0, None] - offset
    lowest, highest = left.min(axis=2), left.max(axis=2)
    forward = (length > 1e-9) & (lowest > -1e-9) & (highest > 1e-6)
    backward = (length > 1e-9) & (highest < 1e-9) & (lowest < -1e-6)
    margin = np.minimum(
        np.where(forward, distance, np.inf).min(axis=1), np.where(backward, -distance, np.inf).min(axis=1)
    )
    return np.where(np.isfinite(margin), margin, np.nan)
