"""The contact wrench that a motion needs, and how the sole corners share it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from excite.arrays import Array
from excite.lazy_kernel import LazyKernel

# How the ground's forces share a wrench among sole corners.
#
# Everything here takes arrays over samples, in the world frame with z up, and knows no robot.

# Length that makes moments comparable with forces: half a foot [m].
_LENGTH = 0.1
# Weight of the forces' own size against the wrench's residual, both relative to the weight: large enough to
# make the distribution unique and continuous in time, small enough to leave 1e-4 of the wrench unmet.
_REGULARISATION = 1e-2
# Relative residual up to which a wrench counts as supplied.
RESIDUAL_TOLERANCE = 1e-3
# Gradient of the dual, relative to the weight, at which Newton's method has arrived; its most steps, and halvings
# of one.
_ARRIVED, _STEPS, _HALVINGS = 1e-10, 100, 40


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
    cone = _solve_cone(wrench, corners, friction)
    residual = cone.residual
    for k in np.flatnonzero(~(residual <= RESIDUAL_TOLERANCE)):
        residual[k] = _distance_to_cone(cone.rays[k], cone.target[k])
    edges = friction_edges(friction)
    forces = np.einsum("nme,mec->nmc", cone.weights.reshape(n, m, 4), edges) * cone.scale[:, None, None]
    return ContactForces(forces, residual)


def shares_of_wrench(wrench: Array, corners: Array, friction: Array, counts: Sequence[int]) -> Array:
    """How feet share small changes of a wrench that :func:`distribute_wrench` has shared.

    Of the rays that carry the solution is linear, ``x = Gᵀ(GGᵀ + ε²)⁻¹ w``: these are held, so that the shares are
    exact as long as no corner comes to carry, or stops.

    Args:
        wrench: ``(n, 6)`` force, then moment about the world origin, world frame [N, N·m].
        corners: ``(n, m, 3)`` sole corners that carry load, foot after foot [m].
        friction: ``(m,)`` friction coefficient at each corner.
        counts: corners of each foot, ``m`` together.

    Returns:
        ``(n, n_feet, 6, 6)`` from the total wrench to each foot's, both about the world origin; they give the very
        forces for the wrench itself. NaN where the forces could not be computed.
    """
    n, m = corners.shape[:2]
    cone = _solve_cone(wrench, corners, friction)
    carrying = np.where(cone.weights > 0.0, cone.rays.transpose(2, 0, 1), 0.0).transpose(1, 2, 0)
    inner = carrying.transpose(0, 2, 1) @ carrying + _REGULARISATION**2 * np.eye(6)
    # From a wrench about the origin to the cone's target, and from the rays' weights to wrenches about the origin.
    to_target = np.tile(np.eye(6), (n, 1, 1))
    # Rows of eⱼ × c are columns of what takes x to −c × x.
    to_target[:, 3:, :3] = np.cross(np.eye(3), corners.mean(axis=1)[:, None]).transpose(0, 2, 1)
    to_target[:, 3:] /= _LENGTH
    of_weights = carrying @ np.linalg.solve(inner, to_target)
    edges = np.broadcast_to(friction_edges(friction), (n, m, 4, 3))
    about_origin = np.concatenate([edges, np.cross(corners[:, :, None], edges)], axis=3).reshape(n, 4 * m, 6)
    ends = np.cumsum([4 * count for count in counts])
    shares = [
        about_origin[:, end - 4 * count : end].transpose(0, 2, 1) @ of_weights[:, end - 4 * count : end]
        for count, end in zip(counts, ends, strict=True)
    ]
    found = np.stack(shares, axis=1)
    found[~np.isfinite(cone.residual)] = np.nan
    return found


def cone_facets(corners: Array, friction: Array) -> Array:
    """Facets of the cone of wrenches that forces inside the corners' friction pyramids supply.

    Of all rays the vertical force is one, so that the cone is that of the polytope which they span in the other five
    coordinates (the contact wrench cone's faces; Caron, Pham and Nakamura 2015).

    Args:
        corners: ``(m, 3)`` sole corners that carry load [m].
        friction: ``(m,)`` friction coefficient at each corner.

    Returns:
        ``(n_facets, 6)``: wrenches about the origin of ``corners`` with ``facets @ w ≤ 0`` are in the cone; none where
        the cone is flat (points on a line).
    """
    edges = friction_edges(friction)
    arms = np.cross(corners[:, None], edges) / _LENGTH
    rays = np.concatenate([edges, arms], axis=2).reshape(-1, 6)
    try:
        hull = scipy.spatial.ConvexHull(rays[:, [0, 1, 3, 4, 5]])
    except scipy.spatial.QhullError:
        return np.zeros((0, 6))
    found = np.unique(np.round(hull.equations, 9), axis=0)
    return np.asarray(np.column_stack([found[:, :2], found[:, 5], found[:, 2:5] / _LENGTH]))


class _Cone(NamedTuple):
    """Rays ``(n, 4·m, 6)`` about the corners' middle, the wrench there as they are scaled, and its scale ``(n,)``.

    The rays' weights ``(n, 4·m)`` are those of the regularised problem, whose residual is ``(n,)``.
    """

    rays: Array
    target: Array
    scale: Array
    weights: Array
    residual: Array


def _solve_cone(wrench: Array, corners: Array, friction: Array) -> _Cone:
    n, m = corners.shape[:2]
    scale = np.maximum(np.linalg.norm(wrench[:, :3], axis=1), 1e-9)
    edges = friction_edges(friction)
    centre = corners.mean(axis=1)
    moment = wrench[:, 3:] - np.cross(centre, wrench[:, :3])
    target = np.hstack([wrench[:, :3], moment / _LENGTH]) / scale[:, None]
    arms = np.cross((corners - centre[:, None])[:, :, None], edges[None]) / _LENGTH
    rays = np.concatenate([np.broadcast_to(edges, arms.shape), arms], axis=3).reshape(n, 4 * m, 6)
    weights, residual = np.empty((n, 4 * m)), np.empty(n)
    _nearest_in_cones(rays, target, _REGULARISATION**2, weights, residual)
    return _Cone(rays, target, scale, weights, residual)


def _distance_to_cone(rays: Array, target: Array) -> float:
    """Distance of a wrench from the cone, infinite where it could not be computed."""
    if not np.isfinite(target).all() or not np.isfinite(rays).all():
        return np.inf
    try:
        # scipy.optimize takes 0.15 s to load, which most commands do not need.
        from scipy.optimize import nnls

        return float(nnls(rays.T, target)[1])
    except RuntimeError:  # the solver gives up: unsafe
        return np.inf


# Loops in place of array expressions in what follows: each expression takes numba a second to compile.
@LazyKernel
def _nearest_in_cones(rays, targets, square, weights, residuals):
    """Solve ``min ½‖Gx − w‖² + ½ε²‖x‖², x ≥ 0`` for each sample; NaN and infinity where it did not arrive.

    With the residual ``r = w − Gx`` the solution is ``x = max(0, Gᵀr)/ε²``, and r minimises the convex
    ``½‖r‖² + ‖max(0, Gᵀr)‖²/(2ε²) − wᵀr``: six unknowns however many corners. Its Newton steps, with halving
    where it does not descend, arrive exactly once the set of active rays is right (Hintermüller, Ito and
    Kunisch 2002).
    """
    along, r, trial = np.empty(rays.shape[1]), np.empty(6), np.empty(6)
    gradient, hessian, step = np.empty(6), np.empty((6, 6)), np.empty(6)
    for k in range(targets.shape[0]):
        _fill_vector(r, 0.0)
        _fill_vector(along, 0.0)
        _fill_vector(weights[k], np.nan)
        residuals[k] = np.inf
        value = 0.0
        for _ in range(_STEPS):
            _newton_system(rays[k], targets[k], square, r, along, gradient, hessian)
            if _scalar_product(gradient, gradient) <= _ARRIVED * _ARRIVED:
                for j in range(rays.shape[1]):
                    weights[k, j] = along[j] / square
                residuals[k] = np.sqrt(_scalar_product(r, r))
                break
            _cholesky_solve(hessian, gradient, step)
            slope = _scalar_product(gradient, step)
            length = 1.0
            for _ in range(_HALVINGS):
                for a in range(6):
                    trial[a] = r[a] - length * step[a]
                trial_value = _dual_value(rays[k], targets[k], square, trial, along)
                if trial_value <= value - 1e-4 * length * slope + 1e-15:
                    break
                length *= 0.5
            r, trial = trial, r
            value = trial_value


@LazyKernel
def _fill_vector(vector, value):
    """Set all of a vector to a value."""
    for a in range(vector.shape[0]):
        vector[a] = value


@LazyKernel
def _scalar_product(one, other):
    """Scalar product of two vectors of six."""
    total = 0.0
    for a in range(6):
        total += one[a] * other[a]
    return total


@LazyKernel
def _dual_value(rays, target, square, r, along):
    """The dual's value at ``r``; ``max(0, Gᵀr)`` goes into ``along``."""
    value = 0.0
    for a in range(6):
        value += r[a] * (0.5 * r[a] - target[a])
    for j in range(rays.shape[0]):
        product = 0.0
        for a in range(6):
            product += rays[j, a] * r[a]
        along[j] = max(product, 0.0)
        value += 0.5 * along[j] * along[j] / square
    return value


@LazyKernel
def _newton_system(rays, target, square, r, along, gradient, hessian):
    """Fill in the dual's gradient, and its Hessian's lower triangle."""
    for a in range(6):
        gradient[a] = r[a] - target[a]
        for b in range(a):
            hessian[a, b] = 0.0
        hessian[a, a] = 1.0
    for j in range(rays.shape[0]):
        if along[j] > 0.0:
            for a in range(6):
                scaled = rays[j, a] / square
                gradient[a] += scaled * along[j]
                for b in range(a + 1):
                    hessian[a, b] += scaled * rays[j, b]


@LazyKernel
def _cholesky_solve(matrix, right, x):
    """Solve for ``x`` a positive definite system whose lower triangle is given; overwrites the triangle."""
    n = right.shape[0]
    for a in range(n):
        x[a] = right[a]
    for a in range(n):
        for b in range(a):
            matrix[a, a] -= matrix[a, b] * matrix[a, b]
        matrix[a, a] = np.sqrt(matrix[a, a])
        for c in range(a + 1, n):
            for b in range(a):
                matrix[c, a] -= matrix[c, b] * matrix[a, b]
            matrix[c, a] /= matrix[a, a]
        for b in range(a):
            x[a] -= matrix[a, b] * x[b]
        x[a] /= matrix[a, a]
    for a in range(n - 1, -1, -1):
        for c in range(a + 1, n):
            x[a] -= matrix[c, a] * x[c]
        x[a] /= matrix[a, a]


# The wrench that a motion asks of the ground, and where it acts.
#
# Everything here takes arrays over samples, in the world frame with z up, and knows no robot.


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
