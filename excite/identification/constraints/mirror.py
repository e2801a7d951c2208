"""Left and right masses and moments of inertia differ by a share of each other (eq. 15, Jovic et al. 2016)."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.inertia import pseudo_inertia_matrices
from excite.identification.problem import IdentificationProblem
from excite.robot.robot import Robot

_MIRROR = np.diag([1.0, -1.0, 1.0])
_DIAGONAL = (4, 6, 9)


def mirrored_pairs(
    problem: IdentificationProblem, share: float, free: Collection[int] = ()
) -> LinearConstraints:
    """``(1 − α) x_j ≤ x_i ≤ (1 + α) x_j`` and the same with ``i`` and ``j`` exchanged.

    ``x`` are the mass and the three moments of inertia about the axes of the joint frame; those of the left
    segment are taken about the right segment's axes mirrored at the sagittal (x–z) plane of the base, with
    the robot in its zero configuration, so that the frames need not be mirror images themselves.

    Args:
        problem: the problem; its robot says which segments are pairs.
        share: α.
        free: segments whose pairs have no rows.
    """
    rows: list[Array] = []
    labels: list[str] = []
    for index, segment in enumerate(problem.robot.segments):
        other = segment.pair
        if other is None or other < index or index in free or other in free:
            continue
        mirror = mirrored_parameters(problem.robot, index, other)
        for place in (0, *_DIAGONAL):
            left, right = np.zeros(problem.n_params), np.zeros(problem.n_params)
            left[10 * index : 10 * index + 10] = mirror[place]
            right[10 * other + place] = 1.0
            rows += [
                right - (1.0 - share) * left,
                (1.0 + share) * left - right,
                left - (1.0 - share) * right,
                (1.0 + share) * right - left,
            ]
            labels += [f"mirror:{segment.link}"] * 4
    matrix = np.array(rows) if rows else np.zeros((0, problem.n_params))
    return LinearConstraints(matrix, np.zeros(len(rows)), tuple(labels))


def mirrored_parameters(robot: Robot, left: int, right: int) -> Array:
    """``(10, 10)``: parameters of a right segment that is the mirror image of a left one.

    With the mirror image ``x ↦ T x`` of homogeneous points the pseudo-inertia becomes ``T J Tᵀ``.
    """
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, pin.neutral(robot.model))
    a, b = data.oMi[robot.segments[left].joint], data.oMi[robot.segments[right].joint]
    base = data.oMi[1] if robot.floating else pin.SE3.Identity()
    a, b = base.actInv(a), base.actInv(b)
    transform = np.eye(4)
    transform[:3, :3] = b.rotation.T @ _MIRROR @ a.rotation
    transform[:3, 3] = b.rotation.T @ (_MIRROR @ a.translation - b.translation)
    unit = np.vstack([pseudo_inertia_matrices(row)[0][None] for row in np.eye(10)])
    return np.column_stack([parameters_of_pseudo_inertia(transform @ j @ transform.T) for j in unit])


def parameters_of_pseudo_inertia(pseudo: Array) -> Array:
    """Ten parameters in pinocchio's order of a pseudo-inertia ``(4, 4)``."""
    sigma = pseudo[:3, :3]
    inertia = np.trace(sigma) * np.eye(3) - sigma
    six = inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return np.concatenate([[pseudo[3, 3]], pseudo[:3, 3], six])
