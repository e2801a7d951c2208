"""Least squares over linear inequalities and cones of positive semidefinite matrices, through clarabel."""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import numpy as np
from scipy import sparse

from excite.arrays import Array

# Upper triangle by columns, clarabel's order; the first six are also pinocchio's order of an inertia.
TRIANGLE = tuple((i, j) for j in range(4) for i in range(j + 1))


@dataclass(frozen=True, eq=False)
class ConeProgram:
    """``min ½‖B z − d‖² + ½‖w∘(z − center)‖²`` over ``A z ≥ b`` and ``M_k(z) ⪰ 0``.

    Attributes:
        matrix: ``B``, ``(k, n)``.
        target: ``d``, ``(k,)``.
        rows: ``A``, ``(m, n)``.
        bound: ``b``, ``(m,)``.
        cones: arrays ``(n_cones, t, n)``: upper triangles by columns, linear in ``z``, ``t`` 6 or 10.
        weight: ``w``, ``(n,)``.
        center: ``(n,)``.
        scale: size of each variable, ``(n,)``.
    """

    matrix: Array
    target: Array
    rows: Array
    bound: Array
    cones: tuple[Array, ...]
    weight: Array
    center: Array
    scale: Array


@dataclass(frozen=True, eq=False)
class ConeAnswer:
    """What the solver says; nothing in it is to be believed before it is recomputed.

    Attributes:
        z: ``(n,)``.
        linear: multipliers of the rows, ``(m,)``, clipped to be valid.
        cones: multipliers of the cones, one array ``(n_cones, t)`` each, projected to be valid, such that
            ``Σ cones·rows`` is the inner product of the matrices.
    """

    z: Array
    linear: Array
    cones: tuple[Array, ...]


def solve_cone_program(program: ConeProgram) -> ConeAnswer | None:
    """Solve; None where the solver says that nothing meets the constraints or gives no numbers.

    The solver is given the step from the unconstrained optimum. There the residual is small, and tolerances relative to
    it mean something; beside the whole measurement, multipliers were so coarse that rounding decided what they prove.
    """
    k, m = len(program.target), len(program.bound)
    start = _unconstrained_optimum(program)
    stacked = [np.sqrt(_entry_counts(cone.shape[1]))[:, None] * cone for cone in program.cones]
    blocks = [program.matrix, -program.rows, *(-cone.reshape(-1, cone.shape[2]) for cone in stacked)]
    left = np.vstack(blocks) * program.scale
    right = np.zeros((len(left), k))
    right[:k] = -np.eye(k)
    bound = np.concatenate([program.target, -program.bound, np.zeros(len(left) - k - m)])
    bound -= np.vstack(blocks) @ start
    squares = (program.weight * program.scale) ** 2
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    # Rows and cones have unit length already; another scaling makes multipliers of redundant rows diverge.
    settings.equilibrate_enable = False
    kinds = [clarabel.ZeroConeT(k), clarabel.NonnegativeConeT(m)]
    for cone in program.cones:
        kinds += [clarabel.PSDTriangleConeT(3 if cone.shape[1] == 6 else 4)] * len(cone)
    solution = clarabel.DefaultSolver(
        sparse.diags(np.concatenate([squares, np.ones(k)]), format="csc"),
        np.concatenate([-squares * (program.center - start) / program.scale, np.zeros(k)]),
        sparse.hstack([sparse.csc_matrix(left), sparse.csc_matrix(right)], format="csc"),
        bound,
        kinds,
        settings,
    ).solve()
    z, dual = start + np.array(solution.x)[: len(program.scale)] * program.scale, np.array(solution.z)
    if "Infeasible" in str(solution.status) or not (np.isfinite(z).all() and np.isfinite(dual).all()):
        return None
    cones, at = [], k + m
    for cone in stacked:
        length = cone.shape[0] * cone.shape[1]
        cones.append(_nearest_valid(dual[at : at + length].reshape(cone.shape[:2])))
        at += length
    return ConeAnswer(z, np.maximum(dual[k : k + m], 0.0), tuple(cones))


def _unconstrained_optimum(program: ConeProgram) -> Array:
    """Where the objective is least without constraints; nearest to ``center`` in directions that nothing measures."""
    rows = np.vstack([program.matrix, np.diag(program.weight)]) * program.scale
    rest = np.concatenate([program.target - program.matrix @ program.center, np.zeros(len(program.weight))])
    return np.asarray(program.center + program.scale * np.linalg.lstsq(rows, rest, rcond=None)[0])


def symmetric_matrices(triangles: Array) -> Array:
    """Symmetric matrices of upper triangles by columns, ``(n, t)`` → ``(n, 3 or 4, 3 or 4)``."""
    order = 3 if triangles.shape[1] == 6 else 4
    full = np.empty((len(triangles), order, order))
    for place, (i, j) in enumerate(TRIANGLE[: triangles.shape[1]]):
        full[:, i, j] = full[:, j, i] = triangles[:, place]
    return full


def _entry_counts(length: int) -> Array:
    """How often each entry of a triangle stands in the matrix: 1 or 2."""
    return np.array([1.0 if i == j else 2.0 for i, j in TRIANGLE[:length]])


def _nearest_valid(dual: Array) -> Array:
    """Nearest positive semidefinite multipliers, entries off the diagonal counted twice."""
    counts = _entry_counts(dual.shape[1])
    values, vectors = np.linalg.eigh(symmetric_matrices(dual / np.sqrt(counts)))
    full = (vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1)
    places = np.array(TRIANGLE[: dual.shape[1]])
    return np.asarray(full[:, places[:, 0], places[:, 1]] * counts)
