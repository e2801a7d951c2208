"""The wrench that a motion asks of the ground, where it acts, and whether soles can exert it.

Everything here takes arrays over samples, in the world frame with z up, and knows no robot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Array = NDArray[np.float64]

# Length that makes moments comparable with forces: half a foot [m].
_LENGTH = 0.1
# Weight of the forces' own size against the wrench's residual, both relative to the weight: large enough to
# make the distribution unique and continuous in time, small enough to leave 1e-4 of the wrench unmet.
_REGULARISATION = 1e-2
# Samples that are worked on at a time, to bound memory.
_BLOCK = 1024
# Relative residual up to which a wrench counts as supplied.
RESIDUAL_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Forces of the ground on sole corners.

    Attributes:
        forces: ``(n, m, 3)`` [N], world frame.
        residual: ``(n,)`` norm of the wrench that no admissible forces supply, relative to the wrench
            (moments in units of force × 0.1 m): above RESIDUAL_TOLERANCE the contacts cannot
            carry the motion.
    """

    forces: Array
    residual: Array


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
        corners: ``(n, m, 2)`` [m], three or more that do not lie on a line.
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


def friction_edges(friction: Array) -> Array:
    """Edges of the friction pyramids inscribed in the Coulomb cones of level ground.

    Args:
        friction: ``(m,)`` coefficients.

    Returns:
        ``(m, 4, 3)`` directions with a vertical component of one; non-negative sums of them lie in the cone.
    """
    edges = np.zeros((len(friction), 4, 3))
    edges[:, :, 2] = 1.0
    edges[:, 0, 0] = edges[:, 2, 1] = friction
    edges[:, 1, 0] = edges[:, 3, 1] = -friction
    return edges


def distribute_wrench(wrench: Array, corners: Array, friction: Array) -> ContactForces:
    """Share a contact wrench among sole corners by regularised non-negative least squares.

    Per sample ``min ‖G x − w‖² + ε²‖x‖², x ≥ 0`` with the corners' friction-pyramid edges as columns of G:
    the forces exist up to the residual exactly if w lies in the contact wrench cone (Caron, Pham and Nakamura
    2015). The regularisation chooses the smallest forces where they are not unique (two feet), continuously
    in time. Where its own residual, of order ε², leaves doubt, the plain problem settles it.

    Args:
        wrench: ``(n, 6)`` force, then moment about the world origin, world frame [N, N·m].
        corners: ``(n, m, 3)`` sole corners that carry load, world frame [m].
        friction: ``(m,)`` friction coefficient at each corner.

    Returns:
        The corners' forces and the relative residual.
    """
    n, m = corners.shape[:2]
    scale = np.maximum(np.linalg.norm(wrench[:, :3], axis=1), 1e-9)
    edges = friction_edges(friction)
    centre = corners.mean(axis=1)
    moment = wrench[:, 3:] - np.cross(centre, wrench[:, :3])
    target = np.hstack([wrench[:, :3], moment / _LENGTH]) / scale[:, None]
    arms = np.cross((corners - centre[:, None])[:, :, None], edges[None]) / _LENGTH
    columns = np.concatenate([np.broadcast_to(edges, arms.shape), arms], axis=3).reshape(n, 4 * m, 6)
    matrix = np.zeros((6 + 4 * m, 4 * m))
    matrix[6:] = _REGULARISATION * np.eye(4 * m)
    right = np.zeros(6 + 4 * m)
    weights, residual = np.empty((n, 4 * m)), np.empty(n)
    for k in range(n):
        matrix[:6], right[:6] = columns[k].T, target[k]
        weights[k], residual[k] = _solve(matrix, right)
    forces = np.einsum("nme,mec->nmc", weights.reshape(n, m, 4), edges) * scale[:, None, None]
    return ContactForces(forces, residual)


def _solve(matrix: Array, right: Array) -> tuple[Array, float]:
    """Weights and residual of the first six rows; a solver that gives up counts as infeasible."""
    try:
        weights, _ = nnls(matrix, right)
        residual = float(np.linalg.norm(matrix[:6] @ weights - right[:6]))
        if residual > RESIDUAL_TOLERANCE:
            _, residual = nnls(matrix[:6], right[:6])
    except RuntimeError:
        return np.full(matrix.shape[1], np.nan), np.inf
    return weights, residual
