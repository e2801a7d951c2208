"""Least squares over linear inequalities and cones of positive semidefinite matrices, through clarabel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import clarabel
import numpy as np
from scipy import sparse

from excite.arrays import Array
from excite.identification.constraints.cones import Triangle, triangle_of

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
    # Where the objective is least without constraints; nearest to center in directions that nothing measures.
    rows = np.vstack([program.matrix, np.diag(program.weight)]) * program.scale
    rest = np.concatenate([program.target - program.matrix @ program.center, np.zeros(len(program.weight))])
    start = np.asarray(program.center + program.scale * np.linalg.lstsq(rows, rest, rcond=None)[0])
    stacked = [_layout_of(cone).root[:, None] * cone for cone in program.cones]
    blocks = [program.matrix, -program.rows, *(-cone.reshape(-1, cone.shape[2]) for cone in stacked)]
    left = np.vstack(blocks) * program.scale
    right = np.zeros((len(left), k))
    right[:k] = -np.eye(k)
    bound = np.concatenate([program.target, -program.bound, np.zeros(len(left) - k - m)])
    bound -= np.vstack(blocks) @ start
    squares = (program.weight * program.scale) ** 2
    kinds = [clarabel.ZeroConeT(k), clarabel.NonnegativeConeT(m)]
    for cone in program.cones:
        kinds += [clarabel.PSDTriangleConeT(3 if cone.shape[1] == 6 else 4)] * len(cone)
    found = solve_clarabel(
        np.concatenate([squares, np.ones(k)]),
        np.concatenate([-squares * (program.center - start) / program.scale, np.zeros(k)]),
        sparse.hstack([sparse.csc_matrix(left), sparse.csc_matrix(right)], format="csc"),
        bound,
        kinds,
    )
    z, dual = start + found.x[: len(program.scale)] * program.scale, found.dual
    if found.infeasible or not (np.isfinite(z).all() and np.isfinite(dual).all()):
        return None
    cones, at = [], k + m
    for cone in stacked:
        length = cone.shape[0] * cone.shape[1]
        layout, values = _layout_of(cone), dual[at : at + length].reshape(cone.shape[:2])
        # Entries off the diagonal count twice.
        cones.append(layout.nearest_positive(values) * layout.root)
        at += length
    return ConeAnswer(z, np.maximum(dual[k : k + m], 0.0), tuple(cones))


class ClarabelAnswer(NamedTuple):
    """What clarabel says: the variables, the multipliers of all rows, whether it calls the problem infeasible."""

    x: Array
    dual: Array
    infeasible: bool


def solve_clarabel(
    squares: Array, linear: Array, matrix: Any, bound: Array, kinds: list[Any], tolerance: float | None = None
) -> ClarabelAnswer:
    """``min ½ Σ squares·x² + linear·x`` with ``bound − matrix·x`` in cones, by clarabel (Goulart and Chen 2024).

    Args:
        squares: ``(n,)``.
        linear: ``(n,)``.
        matrix: sparse, ``(m, n)``.
        bound: ``(m,)``.
        kinds: clarabel's cones, in the order of the rows.
        tolerance: of gap and feasibility; clarabel's own if None.
    """
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    # Rows and cones have unit length already; another scaling makes multipliers of redundant rows diverge.
    settings.equilibrate_enable = False
    if tolerance is not None:
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        settings.tol_infeas_abs = settings.tol_infeas_rel = tolerance
    quadratic = sparse.diags(squares, format="csc")
    solution = clarabel.DefaultSolver(quadratic, linear, matrix, bound, kinds, settings).solve()
    return ClarabelAnswer(np.array(solution.x), np.array(solution.z), "Infeasible" in str(solution.status))


def _layout_of(cone: Array) -> Triangle:
    return triangle_of(3 if cone.shape[1] == 6 else 4)
