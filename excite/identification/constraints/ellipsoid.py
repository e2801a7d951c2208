"""Where a segment's centre of mass and its mass lie: ellipsoids (eq. 6, Golluccio et al. 2020; Wensing 2018).

An ellipsoid is a matrix ``Q`` ``(4, 4)`` with ``[x; 1]ᵀ Q [x; 1] ≥ 0`` for its points ``x`` [m], in the joint
frame of its segment.
"""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.errors import InputError
from excite.identification.constraints.body import ParameterCones, moving_segments
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.inertia import pseudo_inertia_matrices
from excite.identification.problem import IdentificationProblem

# The nominal body stays inside with this margin: a share of the semi-axes, and of the mass.
_MARGIN = 0.1


def ellipsoid_matrix(center: Array, half: Array) -> Array:
    """``Q`` ``(n, 4, 4)`` of ellipsoids along the frame's axes from centres and semi-axes, both ``(n, 3)`` [m]."""
    inverse = 1.0 / np.asarray(half) ** 2
    q = np.zeros((len(inverse), 4, 4))
    q[:, [0, 1, 2], [0, 1, 2]] = -inverse
    q[:, :3, 3] = q[:, 3, :3] = inverse * center
    q[:, 3, 3] = 1.0 - (inverse * np.asarray(center) ** 2).sum(axis=1)
    return q


def com_ellipsoids(nominal: Array, boxes: Array) -> Array:
    """Ellipsoids inscribed in the boxes of the centres of mass, grown until the nominal ones are inside.

    Args:
        nominal: ``(10·n_segments,)`` parameters of the model.
        boxes: lower and upper corners, ``(n_segments, 2, 3)`` [m].

    Returns:
        ``(n_segments, 4, 4)``.
    """
    ten = nominal.reshape(-1, 10)
    mass = ten[:, :1]
    center, half = boxes.mean(axis=1), 0.5 * (boxes[:, 1] - boxes[:, 0])
    com = np.where(mass > 0.0, ten[:, 1:4] / np.where(mass > 0.0, mass, 1.0), center)
    reach = np.linalg.norm((com - center) / half, axis=1) * (1.0 + _MARGIN)
    return ellipsoid_matrix(center, half * np.maximum(reach, 1.0)[:, None])


def body_ellipsoids(nominal: Array, boxes: Array) -> Array:
    """Least ellipsoids around the boxes, grown until the nominal bodies' mass fits into them.

    Args:
        nominal: ``(10·n_segments,)`` parameters of the model.
        boxes: boxes that contain the bodies, lower and upper corners, ``(n_segments, 2, 3)`` [m].

    Returns:
        ``(n_segments, 4, 4)``.
    """
    center, half = boxes.mean(axis=1), np.sqrt(3.0) * 0.5 * (boxes[:, 1] - boxes[:, 0])
    pseudo = pseudo_inertia_matrices(nominal)
    mass = pseudo[:, 3, 3]
    value = np.einsum("sij,sij->s", pseudo, ellipsoid_matrix(center, half))
    share = np.where(mass > 0.0, (mass - value) / np.where(mass > 0.0, mass, 1.0), 0.0)
    growth = np.sqrt(np.maximum(share / (1.0 - _MARGIN), 1.0))
    return ellipsoid_matrix(center, half * growth[:, None])


def com_in_ellipsoids(problem: IdentificationProblem, ellipsoids: Array) -> ParameterCones:
    """``‖A (h − m c)‖ ≤ m`` with ``AᵀA`` the ellipsoid's shape about its centre ``c`` (eq. 6).

    Raises:
        InputError: a matrix that is not that of an ellipsoid; names its segment.
    """
    segments = moving_segments(problem)
    matrix = np.zeros((len(segments), 4, problem.n_params))
    labels = []
    for place, k in enumerate(segments):
        link = problem.robot.segments[k].link
        shape, center = _ellipsoid_shape(ellipsoids[k], link)
        matrix[place, 0, 10 * k] = 1.0
        matrix[place, 1:, 10 * k] = -shape @ center
        matrix[place, 1:, 10 * k + 1 : 10 * k + 4] = shape
        labels.append(f"com_ellipsoid:{link}")
    return ParameterCones(0, matrix, np.zeros((len(segments), 4)), tuple(labels))


def _ellipsoid_shape(q: Array, link: str) -> tuple[Array, Array]:
    """``A`` and centre of an ellipsoid."""
    eigen, vectors = np.linalg.eigh(-q[:3, :3])
    size = 0.0
    if np.isfinite(q).all() and eigen[0] > 0.0:
        center = np.linalg.solve(-q[:3, :3], q[:3, 3])
        size = float(q[3, 3] + q[:3, 3] @ center)
    if not size > 0.0:
        raise InputError(
            "is no ellipsoid",
            source="settings",
            field=f"ellipsoid of {link}",
            remedy="give [x; 1]ᵀ Q [x; 1] ≥ 0",
        )
    return (vectors * np.sqrt(eigen / size)) @ vectors.T, np.asarray(center, dtype=float)


def mass_in_ellipsoids(problem: IdentificationProblem, ellipsoids: Array) -> LinearConstraints:
    """``tr(J Q) ≥ 0``: with ``J ⪰ 0``, a density inside the ellipsoid has these parameters (Wensing et al. 2018)."""
    segments = moving_segments(problem)
    unit = np.concatenate([pseudo_inertia_matrices(row) for row in np.eye(10)])
    matrix = np.zeros((len(segments), problem.n_params))
    for place, k in enumerate(segments):
        matrix[place, 10 * k : 10 * k + 10] = np.einsum("pij,ij->p", unit, ellipsoids[k])
    labels = tuple(f"body_ellipsoid:{problem.robot.segments[k].link}" for k in segments)
    return LinearConstraints(matrix, np.zeros(len(segments)), labels)
