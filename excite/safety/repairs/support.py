"""The ground's side of balance: support polygons, and linear rows on the contact wrench."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from excite.arrays import Array


@dataclass(frozen=True, eq=False)
class Support:
    """A support polygon: ``normals @ x + offsets ≤ 0`` inside.

    Attributes:
        normals: outward, ``(m, 2)``.
        offsets: ``(m,)`` [m].
        centre: mean of the corners, ``(2,)`` [m].
        inradius: distance of the centre from the nearest edge [m].
        radius: mean distance of the corners from their foot's centre [m], the lever arm of torsional friction; of
            point feet and edges the distance from the centre of all.
        friction: coefficient.
    """

    normals: Array
    offsets: Array
    centre: Array
    inradius: float
    radius: float
    friction: float


def support_of(soles: Sequence[Array], friction: float) -> Support:
    """The support polygon of soles on level ground.

    Args:
        soles: corners of each sole that carries, ``(n_corners, 2 or more)`` [m], world frame.
        friction: smallest friction coefficient among them.
    """
    corners = [sole[:, :2] for sole in soles]
    together = np.vstack(corners)
    # Qhull's equations: outward unit normal and offset, n·x + c ≤ 0 inside; one for each edge.
    equations = np.unique(np.round(scipy.spatial.ConvexHull(together).equations, 9), axis=0)
    centre = together.mean(axis=0)
    flat = all(len(sole) >= 3 for sole in corners)
    apart = [c - (c.mean(axis=0) if flat else centre) for c in corners]
    return Support(
        normals=equations[:, :2],
        offsets=equations[:, 2],
        centre=centre,
        inradius=float(-(equations[:, :2] @ centre + equations[:, 2]).max()),
        radius=float(np.mean([np.linalg.norm(c, axis=1).mean() for c in apart])),
        friction=friction,
    )


def zmp_rows(w: Array, support: Support, margin: float | Array) -> Array:
    """Rows that keep the zero-moment point inside: ``n·(f_z p) + (c + margin) f_z ≤ 0``, ``f_z p = (−m_y, m_x)``.

    Args:
        w: wrenches about the world origin, ``(…, 6)``, relative to the weight.
        support: the support polygon.
        margin: distance from its edge [m], one or of a shape that goes with ``(…, n_edges)``.

    Returns:
        ``(…, n_edges)``, in units of 0.1 m of distance.
    """
    point = np.stack([-w[..., 4], w[..., 3]], axis=-1)
    return 10.0 * (point @ support.normals.T + w[..., 2:3] * (support.offsets + margin))


def friction_rows(w: Array, support: Support, share: float) -> Array:
    """Rows against slipping and turning: ``±f_x ± f_y ± m_z/r ≤ share·μ f_z``, moment about the polygon's centre.

    Args:
        w: wrenches about the world origin, ``(…, 6)``, relative to the weight.
        support: the support polygon.
        share: of the friction coefficient.

    Returns:
        ``(…, 8)``.
    """
    vertical = w[..., 5] - (support.centre[0] * w[..., 1] - support.centre[1] * w[..., 0])
    parts = np.stack([w[..., 0], w[..., 1], vertical / support.radius], axis=-1)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    return np.asarray(parts @ signs.T - share * support.friction * w[..., 2:3])
