"""Nearest points under linear constraints and cones: clarabel's answer, refined and judged without its word."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import clarabel
import numpy as np
from scipy import sparse
from scipy.linalg import lu_factor, lu_solve

from excite.arrays import Array
from excite.identification.constraints.cones import Cones
from excite.identification.constraints.linear import LinearConstraints

_TOLERANCE = 1e-10
_REFINEMENTS = 12
# Keeps redundant constraints, whose multipliers are not unique, from making the refinement's matrix singular.
_REGULAR = 1e-11
_SHARES = (1.0, 0.3, 0.1, 0.03)


@dataclass(frozen=True, eq=False)
class ConicProblem:
    """``min ½ Σ w (z − target)²`` with linear constraints and cones.

    Attributes:
        target: ``(n,)``.
        linear: rows on ``z``, of unit length.
        cones: blocks on ``z``.
        weights: ``w``, ``(n,)``; ones where None.
    """

    target: Array
    linear: LinearConstraints
    cones: tuple[Cones, ...]
    weights: Array | None = None


@dataclass(frozen=True, eq=False)
class ConicAnswer:
    """What a solver says.

    Attributes:
        z: ``(n,)``.
        multipliers: of the linear rows, then of the cones' entries.
        infeasible: whether it says that there is no point.
    """

    z: Array
    multipliers: Array
    infeasible: bool = False


ConicSolver = Callable[[ConicProblem], ConicAnswer]


def stack_rows(problem: ConicProblem) -> tuple[Array, Array]:
    """All rows ``M`` and offsets ``c``: ``M z + c`` lies in ``{0} × ℝ₊ × cones``."""
    matrices = [
        problem.linear.matrix,
        *(cones.matrix.reshape(-1, cones.matrix.shape[2]) for cones in problem.cones),
    ]
    bounds = [-problem.linear.bound, *(cones.bound.ravel() for cones in problem.cones)]
    return np.vstack(matrices), np.concatenate(bounds)


def interior_point(problem: ConicProblem, tolerance: float = _TOLERANCE) -> ConicAnswer:
    """Clarabel (Goulart and Chen 2024) on one thread.

    Centred at the unconstrained optimum, where the objective is small: relative tolerances then mean
    something.
    """
    matrix, offset = stack_rows(problem)
    linear, n = problem.linear, len(problem.target)
    kinds = [
        clarabel.ZeroConeT(linear.n_equal),
        clarabel.NonnegativeConeT(len(linear.bound) - linear.n_equal),
    ]
    for cones in problem.cones:
        kind = clarabel.PSDTriangleConeT(cones.order) if cones.order else clarabel.SecondOrderConeT(4)
        kinds += [kind] * len(cones.bound)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    # Rows and blocks have unit length already; another scaling makes multipliers of redundant rows diverge.
    settings.equilibrate_enable = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    weights = np.ones(n) if problem.weights is None else problem.weights
    solver = clarabel.DefaultSolver(
        sparse.diags(weights, format="csc"),
        np.zeros(n),
        sparse.csc_matrix(-matrix),
        matrix @ problem.target + offset,
        kinds,
        settings,
    )
    solution = solver.solve()
    return ConicAnswer(
        problem.target + np.array(solution.x), np.array(solution.z), "Infeasible" in str(solution.status)
    )


def refine_answer(problem: ConicProblem, answer: ConicAnswer) -> ConicAnswer:
    """Newton's steps on ``λ = Π(λ − M z(λ) − c)`` with ``z = target + Mᵀλ`` (Qi and Sun 1993).

    From an interior-point answer they converge quadratically to rounding where the constraints are not
    redundant; a shorter step is taken where the full one does not help. The answer whose recomputed
    distance to the optimum is smaller is returned.
    """
    matrix, offset = stack_rows(problem)
    gram = matrix @ matrix.T
    start = matrix @ problem.target + offset

    def residual_of(dual: Array) -> tuple[Array, Array]:
        value = dual - start - gram @ dual
        return value, dual - _project_dual(problem, value)

    dual = _project_dual(problem, answer.multipliers)
    value, residual = residual_of(dual)
    error = float(np.linalg.norm(residual))
    for _ in range(_REFINEMENTS):
        if error < 1e-14 * max(1.0, float(np.linalg.norm(dual))):
            break
        factor = lu_factor(_projection_jacobian(problem, value, gram), overwrite_a=True, check_finite=False)
        change = lu_solve(factor, residual, check_finite=False)
        for share in _SHARES:
            tried = dual - share * change
            value_there, residual_there = residual_of(tried)
            size = float(np.linalg.norm(residual_there))
            if size < error:
                break
        else:
            break
        dual, value, residual, error = tried, value_there, residual_there, size
    better = ConicAnswer(problem.target + matrix.T @ dual, dual)
    return better if conic_distance(problem, better) < conic_distance(problem, answer) else answer


def _split_vector(problem: ConicProblem, vector: Array) -> tuple[Array, list[Array]]:
    place = len(problem.linear.bound)
    head, rest = vector[:place], []
    for cones in problem.cones:
        rest.append(vector[place : place + cones.bound.size].reshape(cones.bound.shape))
        place += cones.bound.size
    return head, rest


def _project_dual(problem: ConicProblem, vector: Array) -> Array:
    """Nearest point of the dual cone; multipliers of equalities are free."""
    head, rest = _split_vector(problem, vector)
    flat = np.maximum(head, 0.0)
    flat[: problem.linear.n_equal] = head[: problem.linear.n_equal]
    blocks = (cones.projected(part).ravel() for cones, part in zip(problem.cones, rest, strict=True))
    return np.concatenate([flat, *blocks])


def _projection_jacobian(problem: ConicProblem, vector: Array, gram: Array) -> Array:
    """Derivative of ``λ − Π(λ − c − gram·λ)``, block by block."""
    head, rest = _split_vector(problem, vector)
    flat = (head > 0.0).astype(float)
    flat[: problem.linear.n_equal] = 1.0
    full = np.eye(len(vector))
    part = np.arange(len(head))
    full[part] += flat[:, None] * gram[: len(head)]
    full[part, part] -= flat
    place = len(head)
    for cones, values in zip(problem.cones, rest, strict=True):
        for block in cones.derivative(values):
            rows = slice(place, place + cones.size)
            full[rows] += block @ gram[rows]
            full[rows, rows] -= block
            place += cones.size
    full[np.diag_indices_from(full)] += _REGULAR
    return full


def conic_violations(problem: ConicProblem, z: Array) -> dict[str, float]:
    """Largest violation of each kind of constraint at a point, from the point alone."""
    worst: dict[str, float] = {}
    values = list(zip(problem.linear.labels, problem.linear.violations(z), strict=True))
    for cones in problem.cones:
        values += list(zip(cones.labels, np.maximum(-cones.margin(cones.values(z)), 0.0), strict=True))
    for label, value in values:
        kind = label.split(":")[0]
        worst[kind] = max(worst.get(kind, 0.0), float(value))
    return worst


def conic_distance(problem: ConicProblem, answer: ConicAnswer) -> float:
    """Bound on the distance from an answer to the optimum, from its duality gap; ``weights`` must be None.

    Multipliers are put into their cones first; nothing that the solver says of itself is used. Infinite where they are
    not finite.
    """
    if not np.isfinite(answer.multipliers).all():
        return np.inf
    matrix, offset = stack_rows(problem)
    dual = _project_dual(problem, answer.multipliers)
    stationarity = answer.z - problem.target - matrix.T @ dual
    slack = float(dual @ (matrix @ answer.z + offset))
    return float(np.sqrt(stationarity @ stationarity + 2.0 * abs(slack)))
