"""Physical parameters μ (mass, centre of mass, inertia about it) and the standard ones θ that data see."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.identification.inertia import COLUMNS, ROWS, central_inertia_matrices

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
