"""The centre of mass lies inside a box (eq. 10 and 11 of Jovic et al., T-RO 2016)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from excite.identification.constraints.linear import LinearConstraints
from excite.identification.inertia import central_inertia_matrices
from excite.identification.problem import IdentificationProblem
from excite.robot.robot import Array, Robot

_SMALLEST_HALF = 0.01


def com_in_box(problem: IdentificationProblem, boxes: Mapping[str, tuple[Array, Array]]) -> LinearConstraints:
    """``lower·m ≤ (mx, my, mz) ≤ upper·m`` for each link named in ``boxes``.

    Args:
        problem: the problem.
        boxes: by link, lower and upper corner in the joint frame [m].
    """
    rows, labels = [], []
    for index, segment in enumerate(problem.robot.segments):
        if segment.link not in boxes:
            continue
        lower, upper = boxes[segment.link]
        for axis in range(3):
            for sign, corner in ((1.0, lower), (-1.0, upper)):
                row = np.zeros(problem.n_params)
                row[10 * index] = -sign * corner[axis]
                row[10 * index + 1 + axis] = sign
                rows.append(row)
                labels.append(f"com_box:{segment.link}")
    matrix = np.array(rows) if rows else np.zeros((0, problem.n_params))
    return LinearConstraints(matrix, np.zeros(len(rows)), tuple(labels))


def equivalent_boxes(robot: Robot, *, growth: float = 1.0) -> dict[str, tuple[Array, Array]]:
    """Boxes for segments without geometry: the uniform box with the nominal mass and inertia.

    A uniform box of edges a, b, c has ``Ixx = m(b² + c²)/12``; the moments about the nominal centre of mass
    along the joint axes give the edges back.

    Args:
        robot: the robot.
        growth: factor on the edges.

    Returns:
        By link, lower and upper corner in the joint frame [m].
    """
    ten = robot.nominal_parameters.reshape(-1, 10)
    moments = np.einsum("ijj->ij", central_inertia_matrices(robot.nominal_parameters))
    boxes = {}
    for segment, parameters, diagonal in zip(robot.segments, ten, moments, strict=True):
        center = parameters[1:4] / parameters[0]
        squares = 6.0 * (diagonal.sum() - 2.0 * diagonal) / parameters[0]
        half = np.maximum(0.5 * growth * np.sqrt(np.maximum(squares, 0.0)), _SMALLEST_HALF)
        boxes[segment.link] = (center - half, center + half)
    return boxes
