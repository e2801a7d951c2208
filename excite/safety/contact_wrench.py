"""The wrench that a motion asks of the ground, and where it acts.

Everything here takes arrays over samples, in the world frame with z up, and knows no robot.
"""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.lazy_kernel import LazyKernel


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
    edges = hull_edges(corners)
    left = np.einsum("nek,nk->ne", edges[..., :2], points) - edges[..., 2]
    has_area = np.isfinite(edges[:, :, 0]).any(axis=1)
    least = np.fmin.reduce(left, axis=1, initial=np.inf)
    return np.where(has_area & np.isfinite(points).all(axis=1), least, np.nan)


def hull_edges(corners: Array) -> Array:
    """Edges of the convex hull of corners, one hull a sample.

    Args:
        corners: ``(n, m, 2)`` [m].

    Returns:
        ``(n, m, 3)``: inward unit normals and offsets ``c`` [m], ``normal @ point - c`` is the distance inside an edge;
        NaN beyond a hull's last edge, and of a hull without area.
    """
    edges = np.full((*corners.shape[:2], 3), np.nan)
    if corners.shape[1] > 2:
        _write_edges(np.ascontiguousarray(corners, dtype=float), edges)
    return edges


# Two corners that are nearer to each other than this are one, and so are edges; a corner that is this far on a line's
# side is beside it, and a hull that reaches less far from all of its lines has no area [m].
_SAME_M, _AREA_M = 1e-9, 1e-6


@LazyKernel
def _is_known(edges: Array, sample: int, found: int, x: float, y: float) -> bool:
    """Whether one of the first edges of a sample has this normal."""
    known = False
    for k in range(found):
        known = known or max(abs(edges[sample, k, 0] - x), abs(edges[sample, k, 1] - y)) <= _SAME_M
    return known


@LazyKernel
def _write_edges(corners: Array, edges: Array) -> None:
    """Write the edges of each sample's hull that has an area."""
    n_corners = corners.shape[1]
    for sample in range(len(corners)):
        found = 0
        for start in range(n_corners - 1):
            x0, y0 = corners[sample, start, 0], corners[sample, start, 1]
            for end in range(start + 1, n_corners):
                dx, dy = corners[sample, end, 0] - x0, corners[sample, end, 1] - y0
                length = np.sqrt(dx * dx + dy * dy)
                if not length > _SAME_M:
                    continue
                dx, dy = dx / length, dy / length
                offset = dx * y0 - dy * x0
                # Distance to the left of the directed line, of every corner.
                lowest, highest = np.inf, -np.inf
                for corner in range(n_corners):
                    left = dx * corners[sample, corner, 1] - dy * corners[sample, corner, 0] - offset
                    lowest, highest = min(lowest, left), max(highest, left)
                    if lowest <= -_SAME_M and highest >= _SAME_M:
                        break
                if lowest > -_SAME_M and highest > _AREA_M:
                    side = 1.0
                elif highest < _SAME_M and lowest < -_AREA_M:
                    side = -1.0
                else:
                    continue
                if found < n_corners and not _is_known(edges, sample, found, -side * dy, side * dx):
                    edges[sample, found, 0], edges[sample, found, 1] = -side * dy, side * dx
                    edges[sample, found, 2] = side * offset
                    found += 1
