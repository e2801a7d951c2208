"""Drives whose motors turn with several joints, as in the wrists of many arms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from excite.arrays import Array
from excite.errors import InputError, UnknownNameError


def coupling_matrix(joints: Sequence[str], coupling: Mapping[str, Mapping[str, float]]) -> Array:
    """Matrix ``C`` from joint velocities to motor velocities seen through each motor's own gear.

    ``q̇_motor = C q̇`` and, as power is the same on both sides, ``τ_joint = Cᵀ τ_motor`` (Gautier and Janot,
    for the Stäubli TX40: motor 6 turns by the sum of joints 5 and 6).

    Args:
        joints: names in the order of rows and columns.
        coupling: by motor (named after its joint), how much it turns per turn of other joints, for the TX40
            ``{"joint_6": {"joint_5": 1.0}}``.

    Returns:
        ``(n_joints, n_joints)``, ones on the diagonal unless said otherwise.

    Raises:
        UnknownNameError: no such joint.
        InputError: the matrix cannot be inverted.
    """
    names = list(joints)
    matrix = np.eye(len(names))
    for motor, ratios in coupling.items():
        for joint, ratio in ratios.items():
            for name in (motor, joint):
                if name not in names:
                    raise UnknownNameError("joint", name, names)
            matrix[names.index(motor), names.index(joint)] = ratio
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 1e-9:
        raise InputError("has no inverse", field="coupling", remedy="correct the ratios")
    return matrix


def joint_torques(motor: Array, matrix: Array) -> Array:
    """Torques on the joints ``(n, n_joints)`` from those of the motors, reflected through their own gears."""
    return motor @ matrix


def joint_positions(motor: Array, matrix: Array) -> Array:
    """Joint positions ``(n, n_joints)`` from motor positions, each divided by its own gear ratio."""
    return np.asarray(np.linalg.solve(matrix, motor.T).T, dtype=float)
