"""Between which ends a base parameter of any robot lies, whatever its bodies and drives are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from excite.arrays import Array
from excite.identification.inertia import pseudo_inertia_matrices
from excite.regressor.base_parameters import BaseParameters

# Terms that take power out, and rotors: below zero is no robot.
NEVER_NEGATIVE = ("viscous", "coulomb", "armature")
# An eigenvalue this far below zero, of the largest, is rounding, and so is a coefficient of that size.
_ROUNDING = 1e-9


def possible_ends(base: BaseParameters, names: Sequence[str], n_inertial: int) -> Array:
    """Lower and upper end of each base parameter, 0 or infinite, ``(2, n_base)``.

    Pseudo-inertias of bodies are positive semidefinite, a cone that is its own dual: a combination of one body's
    parameters is at least zero for every body exactly where the symmetric matrix ``C`` of ``tr(C J(φ)) = c·φ`` is
    positive semidefinite (Wensing, Kim and Slotine, IEEE RA-L 2018, section III). Friction and rotors are at least
    zero, other terms of drives may be anything.

    Args:
        base: base parameters of all columns.
        names: of all parameters, a drive's as ``TERM.JOINT``.
        n_inertial: how many of them are bodies', ten a segment in pinocchio's order.
    """
    # What rounding left of a column that is none of the combination's is nothing.
    largest = np.abs(base.matrix).max(axis=1, keepdims=True, initial=1e-300)
    matrix = np.where(np.abs(base.matrix) > _ROUNDING * largest, base.matrix, 0.0)
    unit = pseudo_inertia_matrices(np.eye(10).reshape(-1))
    upper = np.triu_indices(4)
    # Entries off the diagonal stand twice in the trace.
    pairs = unit[:, upper[0], upper[1]] * np.where(upper[0] == upper[1], 1.0, 2.0)
    solution = np.linalg.solve(pairs, matrix[:, :n_inertial].reshape(-1, 10).T).T
    dual = np.zeros((len(solution), 4, 4))
    dual[:, upper[0], upper[1]] = dual[:, upper[1], upper[0]] = solution
    values = np.linalg.eigvalsh(dual).reshape(base.rank, -1, 4)
    size = np.abs(values).max(axis=(1, 2), initial=1e-300)[:, None, None]
    positive = np.array([name.partition(".")[0] in NEVER_NEGATIVE for name in names[n_inertial:]], dtype=bool)
    drives = matrix[:, n_inertial:]
    free = (drives[:, ~positive] == 0.0).all(axis=1)
    low = free & (values >= -_ROUNDING * size).all(axis=(1, 2)) & (drives[:, positive] >= 0.0).all(axis=1)
    high = free & (values <= _ROUNDING * size).all(axis=(1, 2)) & (drives[:, positive] <= 0.0).all(axis=1)
    return np.array([np.where(low, 0.0, -np.inf), np.where(high, 0.0, np.inf)])
