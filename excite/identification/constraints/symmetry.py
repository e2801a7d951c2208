"""Left and right segments mirror each other (eq. 4, Jovic 2015; eq. 15, Jovic 2016)."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.problem import IdentificationProblem
from excite.robot.robot import Robot

_MIRROR = np.diag([1.0, -1.0, 1.0])


def symmetric_pairs(
    problem: IdentificationProblem, tolerance: float, free: Collection[int] = ()
) -> LinearConstraints:
    """Mass and first moments of paired segments differ by at most a share of their nominal size.

    The right first moment is compared with the left one mirrored at the base's sagittal (x–z) plane, with
    the robot in its zero configuration; the nominal model's own asymmetry is allowed for.

    Args:
        problem: the problem; its robot says which segments are pairs.
        tolerance: relative difference; at zero the rows are equalities.
        free: segments whose pairs have no rows.
    """
    rows: list[Array] = []
    bounds: list[float] = []
    labels: list[str] = []
    ten = problem.prior[: problem.n_inertial].reshape(-1, 10)
    for index, segment in enumerate(problem.robot.segments):
        if segment.pair is None or segment.pair < index:
            continue
        other = segment.pair
        if index in free or other in free:
            continue
        mirror = _mirror_of_first_moment(problem.robot, index, other)
        nominal = ten[other, :4] - mirror @ ten[index, :4]
        mass = 0.5 * (ten[index, 0] + ten[other, 0])
        length = 0.5 * (np.linalg.norm(ten[index, 1:4]) + np.linalg.norm(ten[other, 1:4]))
        for axis in range(4):
            row = np.zeros(problem.n_params)
            row[10 * other + axis] = 1.0
            row[10 * index : 10 * index + 4] -= mirror[axis]
            allowed = tolerance * (mass if axis == 0 else length)
            label = f"symmetry:{segment.link}"
            if tolerance == 0.0:
                rows, bounds, labels = [*rows, row], [*bounds, nominal[axis]], [*labels, label]
            else:
                rows += [row, -row]
                bounds += [nominal[axis] - allowed, -nominal[axis] - allowed]
                labels += [label, label]
    matrix = np.array(rows) if rows else np.zeros((0, problem.n_params))
    n_equal = len(rows) if tolerance == 0.0 else 0
    return LinearConstraints(matrix, np.array(bounds), tuple(labels), n_equal)


def _mirror_of_first_moment(robot: Robot, left: int, right: int) -> Array:
    """``(4, 4)``: mass and first moment of a right segment whose left twin has these."""
    data = robot.model.createData()
    q = pin.neutral(robot.model)
    pin.forwardKinematics(robot.model, data, q)
    a, b = data.oMi[robot.segments[left].joint], data.oMi[robot.segments[right].joint]
    base = data.oMi[1] if robot.floating else pin.SE3.Identity()
    a, b = base.actInv(a), base.actInv(b)
    matrix = np.zeros((4, 4))
    matrix[0, 0] = 1.0
    matrix[1:, 0] = b.rotation.T @ (_MIRROR @ a.translation - b.translation)
    matrix[1:, 1:] = b.rotation.T @ _MIRROR @ a.rotation
    return matrix
