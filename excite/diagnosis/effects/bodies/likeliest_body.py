"""The likeliest of all bodies that can exist, of a Gaussian estimate of the ten inertial parameters."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.identification.inertia import pseudo_inertia_matrices
from excite.identification.physical.cone_program import TRIANGLE, ConeProgram, solve_cone_program

# Sizes of mass, first moments and moments of inertia, by which the solver scales: a kilogram within a hand's breadth.
_SIZES = np.array([1.0, *[0.1] * 3, *[0.01] * 6])
# Rounding of a solver by which a body's least second moment may lie below zero, as a share of its largest.
_ROUNDING = 1e-6
# By entry of the inertia in the order xx, xy, yy, xz, yz, zz: its second moments ∫ r rᵀ dm are ½ tr(I) 1 − I.
_INERTIA = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def likeliest_body(information: Array, target: Array, reach: float, removable: float) -> Array | None:
    """The body that is added to a link or, where that is likelier, taken away from it.

    Its pseudo-inertia is positive semidefinite (Wensing, Kim and Slotine 2018, eq. 8), and its second moments are no
    larger than those of its mass at the reach.

    Args:
        information: inverse covariance of mass, first moments and moments of inertia about the joint, ``(10, 10)``,
            in pinocchio's order.
        target: ``information`` times their estimate, ``(10,)``.
        reach: largest distance of its parts from the joint [m].
        removable: mass that a link has to lose [kg].

    Returns:
        ``(10,)``, all negative where it is taken away; None where nothing is likelier than any body.
    """
    best, found = 0.0, None
    for sign in (1.0, -1.0):
        answer = _body(information, sign * target, reach, np.inf if sign > 0.0 else removable)
        if answer is None:
            continue
        value = 0.5 * float(answer @ information @ answer) - sign * float(target @ answer)
        if value < best:
            best, found = value, sign * answer
    return found


def exists(body: Array, reach: float, removable: float) -> bool:
    """Whether ten parameters are those of a body as :func:`likeliest_body` finds them, of whatever likelihood.

    Args:
        body: ``(10,)``, all negative where it is taken away.
        reach: largest distance of its parts from the joint [m].
        removable: mass that a link has to lose [kg].
    """
    added = body if body[0] > 0.0 else -body
    if not added[0] > 0.0 or -body[0] > removable * (1.0 + _ROUNDING):
        return False
    # In units of the reach, mass and second moments are alike.
    sizes = np.array([1.0, *[reach] * 3, *[reach**2] * 6])
    values = np.linalg.eigvalsh(pseudo_inertia_matrices(added / sizes))
    spread = 0.5 * float(added[4] + added[6] + added[9])
    return bool(
        values.min() >= -_ROUNDING * values.max() and spread <= reach**2 * added[0] * (1.0 + _ROUNDING)
    )


def _body(information: Array, target: Array, reach: float, most: float) -> Array | None:
    # Scaled before it is factored: moments of inertia and masses are orders of magnitude apart.
    scaled = information * np.outer(_SIZES, _SIZES)
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    root = np.sqrt(np.maximum(values, 1e-12 * values.max()))
    matrix = (root[:, None] * vectors.T) / _SIZES
    triangle = _pseudo_inertia()
    second = triangle[[TRIANGLE.index((i, i)) for i in range(3)]].sum(axis=0)
    rows = [reach**2 * np.eye(10)[0] - second]
    bound = [0.0]
    if np.isfinite(most):
        rows.append(-np.eye(10)[0])
        bound.append(-most)
    answer = solve_cone_program(
        ConeProgram(
            matrix=matrix,
            target=(vectors.T @ (target * _SIZES)) / root,
            rows=np.array(rows),
            bound=np.array(bound),
            cones=(triangle[None],),
            weight=np.zeros(10),
            center=np.zeros(10),
            scale=_SIZES,
        )
    )
    return None if answer is None else answer.z


def _pseudo_inertia() -> Array:
    """Upper triangle of the pseudo-inertia by columns, linear in the ten parameters, ``(10, 10)``."""
    made = np.zeros((10, 10))
    for row, (i, j) in enumerate(TRIANGLE):
        if j < 3:
            made[row, 4 + _INERTIA.index((i, j))] -= 1.0
            if i == j:
                for k in range(3):
                    made[row, 4 + _INERTIA.index((k, k))] += 0.5
        else:
            made[row, 1 + i if i < 3 else 0] = 1.0
    return made
