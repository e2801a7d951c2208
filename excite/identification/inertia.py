"""Ten inertial parameters as matrices, and as mass, centre of mass and inertia about it."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array, Flags

# Places of Ixx, Ixy, Iyy, Ixz, Iyz, Izz (pinocchio's order) in the symmetric 3×3 matrix.
ROWS = np.array([0, 0, 1, 0, 1, 2])
COLUMNS = np.array([0, 1, 1, 2, 2, 2])
# From pinocchio's order to the files' order Ixx, Iyy, Izz, Ixy, Ixz, Iyz.
FILE_ORDER = (0, 2, 5, 1, 3, 4)
# What rounding leaves of a number that should not be negative (eigenvalue, bound), in SI or as share of the largest.
ROUNDING = 1e-9


def inertia_matrices(parameters: Array) -> Array:
    """Inertia about the joint frame's origin, ``(n_segments, 3, 3)`` [kg·m²].

    Args:
        parameters: ``(10·n_segments,)`` in pinocchio's order.
    """
    six = np.asarray(parameters, dtype=float).reshape(-1, 10)[:, 4:]
    matrices = np.empty((len(six), 3, 3))
    matrices[:, ROWS, COLUMNS] = matrices[:, COLUMNS, ROWS] = six
    return matrices


def pseudo_inertia_matrices(parameters: Array) -> Array:
    """Pseudo-inertia ``[[½ tr(I)·1 − I, h], [hᵀ, m]]`` of each segment, ``(n_segments, 4, 4)``.

    A rigid body of positive density exists exactly where it is positive definite (Wensing, Kim and Slotine,
    IEEE RA-L 2018, eq. 10).

    Args:
        parameters: ``(10·n_segments,)`` in pinocchio's order, joint frames.
    """
    ten = np.asarray(parameters, dtype=float).reshape(-1, 10)
    inertia = inertia_matrices(parameters)
    half_trace = 0.5 * np.trace(inertia, axis1=1, axis2=2)
    pseudo = np.empty((len(ten), 4, 4))
    pseudo[:, :3, :3] = half_trace[:, None, None] * np.eye(3) - inertia
    pseudo[:, :3, 3] = pseudo[:, 3, :3] = ten[:, 1:4]
    pseudo[:, 3, 3] = ten[:, 0]
    return pseudo


def are_no_bodies(parameters: Array) -> Flags:
    """Which segments have parameters ``(10·n_segments,)`` that no rigid body has: a pseudo-inertia is not positive.

    Rounding is relative to the body: a hand's inertia is a millionth of a trunk's.
    """
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia_matrices(parameters))
    return np.asarray(eigenvalues[:, 0] < -ROUNDING * np.abs(eigenvalues).max(axis=1))


def parameters_of_pseudo_inertia(pseudo: Array) -> Array:
    """Ten parameters in pinocchio's order of a pseudo-inertia ``(4, 4)``."""
    inertia = np.trace(pseudo[:3, :3]) * np.eye(3) - pseudo[:3, :3]
    return np.concatenate([[pseudo[3, 3]], pseudo[:3, 3], inertia[ROWS, COLUMNS]])


def central_inertia_matrices(parameters: Array) -> Array:
    """Inertia about each segment's centre of mass, joint axes, ``(n_segments, 3, 3)`` [kg·m²].

    A segment whose mass is not positive has no centre of mass; its rows are NaN.
    """
    ten = np.asarray(parameters, dtype=float).reshape(-1, 10)
    mass = np.where(ten[:, 0] > 0.0, ten[:, 0], np.nan)
    h = ten[:, 1:4]
    square = np.einsum("ij,ij->i", h, h)[:, None, None] * np.eye(3) - np.einsum("ij,ik->ijk", h, h)
    return np.asarray(inertia_matrices(parameters) - square / mass[:, None, None])


# Physical parameters μ (mass, centre of mass, inertia about it) and the standard ones θ that data see.

# Places of the diagonal moments among Ixx, Ixy, Iyy, Ixz, Iyz, Izz (pinocchio's order), and of the products.
DIAGONAL = (0, 2, 5)
OFF_DIAGONAL = (1, 3, 4)

NAMES = ("m", "cx", "cy", "cz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")

# Change of the six inertias per unit of the six second moments H = hhᵀ/m: tr(H)·1 − H, eq. (14).
STEINER = np.zeros((6, 6))
STEINER[np.ix_(DIAGONAL, DIAGONAL)] = 1.0
STEINER -= np.eye(6)


def physical_parameters(standard: Array) -> Array:
    """Mass, centre of mass, and inertia about it, of each segment.

    The inverse of eq. (14) of Xu et al. 2020.

    Args:
        standard: ``(10·n,)`` in pinocchio's order about the joint frames [kg, kg·m, kg·m²].

    Returns:
        ``(n, 10)``: ``m, cx, cy, cz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz`` along the joint frames' axes [kg, m,
        kg·m²]; NaN after the mass where it is not positive.
    """
    ten = np.asarray(standard, dtype=float).reshape(-1, 10)
    mass = np.where(ten[:, :1] > 0.0, ten[:, :1], np.nan)
    central = central_inertia_matrices(ten.ravel())
    return np.hstack([ten[:, :1], ten[:, 1:4] / mass, central[:, ROWS, COLUMNS]])


def standard_parameters(physical: Array) -> Array:
    """Standard parameters ``(10·n,)`` of physical ones ``(n, 10)`` (Xu et al. 2020, eq. 14)."""
    mu = np.asarray(physical, dtype=float).reshape(-1, 10)
    mass, centre = mu[:, :1], mu[:, 1:4]
    moments = mass * centre[:, ROWS] * centre[:, COLUMNS]
    return np.hstack([mass, mass * centre, mu[:, 4:] + moments @ STEINER.T]).ravel()


def second_moments(mass: Array, first: Array) -> Array:
    """``hhᵀ/m`` of masses ``(n,)`` and first moments ``(n, 3)``: six entries each, ``(n, 6)`` [kg·m²]."""
    return first[:, ROWS] * first[:, COLUMNS] / mass[:, None]
