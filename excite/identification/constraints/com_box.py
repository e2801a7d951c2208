"""The centre of mass lies inside a box (eq. 10 and 11 of Jovic et al., T-RO 2016)."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.inertia import central_inertia_matrices
from excite.identification.problem import IdentificationProblem
from excite.robot.robot import Robot

_SMALLEST_HALF = 0.01


def com_in_box(problem: IdentificationProblem, boxes: Array) -> LinearConstraints:
    """``lower·m ≤ (mx, my, mz) ≤ upper·m`` for each segment.

    Args:
        problem: the problem.
        boxes: lower and upper corners in the joint frames ``(n_segments, 2, 3)`` [m].
    """
    n = len(problem.robot.segments)
    matrix, labels = np.zeros((n, 3, 2, problem.n_params)), []
    for index, segment in enumerate(problem.robot.segments):
        for axis in range(3):
            for side, sign in enumerate((1.0, -1.0)):
                matrix[index, axis, side, 10 * index] = -sign * boxes[index, side, axis]
                matrix[index, axis, side, 10 * index + 1 + axis] = sign
                labels.append(f"com_box:{segment.link}")
    return LinearConstraints(matrix.reshape(-1, problem.n_params), np.zeros(6 * n), tuple(labels))


def equivalent_boxes(robot: Robot, *, growth: float = 1.5) -> Array:
    """Boxes for segments whose geometry is not at hand: uniform boxes of the nominal mass and inertia.

    A uniform box of edges a, b, c has ``Ixx = m(b² + c²)/12``; the moments about the nominal centre of mass
    along the joint axes give the edges back.

    Args:
        robot: the robot.
        growth: factor on the edges.

    Returns:
        Lower and upper corners in the joint frames ``(n_segments, 2, 3)`` [m].
    """
    ten = robot.nominal_parameters.reshape(-1, 10)
    moments = np.einsum("ijj->ij", central_inertia_matrices(robot.nominal_parameters))
    mass = np.maximum(ten[:, :1], 1e-9)
    squares = 6.0 * (moments.sum(axis=1, keepdims=True) - 2.0 * moments) / mass
    half = np.maximum(0.5 * growth * np.sqrt(np.maximum(np.nan_to_num(squares), 0.0)), _SMALLEST_HALF)
    center = ten[:, 1:4] / mass
    return np.stack([center - half, center + half], axis=1)
