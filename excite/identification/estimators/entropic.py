"""The entropic divergence between bodies as an objective, and the method that solves for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve
from scipy.linalg.lapack import dpotrf

from excite.arrays import Array
from excite.identification.constraints.cones import moving_segments, segment_scales, triangle_of
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.estimators.estimator import (
    Estimate,
    SolveStatus,
    best_known,
    checked_estimate,
    no_solution,
)
from excite.identification.estimators.scaled_problem import Ridge
from excite.identification.estimators.settings import PullSettings
from excite.identification.inertia import pseudo_inertia_matrices
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression

# The problem of the entropic divergence and what a solver says about it.


@dataclass(frozen=True, eq=False)
class EntropicProblem:
    """``min ½‖z − target‖² + Σ wᵢ (−log|Xᵢ| + tr Xᵢ − ½ tr(Xᵢ − 1)²)`` with linear constraints.

    Attributes:
        target: ``(n,)``.
        maps: ``z`` to the ten entries of ``X − 1``, ``(n_segments, 10, n)``.
        weights: ``w``, ``(n_segments,)``.
        linear: rows on ``z``, of unit length.
    """

    target: Array
    maps: Array
    weights: Array
    linear: LinearConstraints

    def relative(self, z: Array) -> Array:
        """``X`` of each segment, ``(n_segments, 4, 4)``."""
        return np.eye(4) + triangle_of(4).matrices(self.maps @ z)

    def violations(self, z: Array) -> dict[str, float]:
        """Largest violation of each kind of constraint."""
        worst = {"pseudo_inertia": abs(float(np.linalg.eigvalsh(self.relative(z))[:, 0].min(initial=0.0)))}
        for label, value in zip(self.linear.labels, self.linear.violations(z), strict=True):
            kind = label.split(":")[0]
            worst[kind] = max(worst.get(kind, 0.0), float(value))
        return worst

    def gradient(self, z: Array) -> Array:
        """``(n,)``; ``X`` must be positive definite."""
        x = self.relative(z)
        slope = triangle_of(4).vectors(2.0 * np.eye(4) - np.linalg.inv(x) - x) * self.weights[:, None]
        return z - self.target + np.tensordot(slope, self.maps, 2)

    def hessian(self, z: Array) -> Array:
        """``(n, n)``."""
        shape = triangle_of(4)
        inverse = np.linalg.inv(self.relative(z))
        unit = shape.matrices(np.eye(10))
        curved = shape.vectors(
            np.einsum("bij,ejk,bkl->beil", inverse, unit, inverse, optimize=True)
        ) - np.eye(10)
        blocks = (curved * self.weights[:, None, None]) @ self.maps
        n = len(z)
        return np.eye(n) + self.maps.reshape(-1, n).T @ blocks.reshape(-1, n)


@dataclass(frozen=True, eq=False)
class EntropicAnswer:
    """What a solver says.

    Attributes:
        z: the point, ``(n,)``.
        multipliers: one a row of the linear constraints, ``(n_rows,)``.
    """

    z: Array
    multipliers: Array


EntropicSolver = Callable[[EntropicProblem], "EntropicAnswer | None"]


# Least squares with the entropic divergence from the nominal bodies, by a primal-dual Newton method.
#
# In the coordinates of the pullback ridge the objective is ``½‖z − d‖² + Σ wᵢ gᵢ(z)``, where ``g`` is what
# the divergence adds to its own second order, so the first Newton step is the pullback solution.


def entropic_distance(problem: EntropicProblem, answer: EntropicAnswer) -> float:
    """Distance to the optimum by its gradient and gap in the local metric, which is exact to second order."""
    e = problem.linear.n_equal
    multipliers = answer.multipliers.copy()
    multipliers[e:] = np.maximum(multipliers[e:], 0.0)
    left = problem.gradient(answer.z) - problem.linear.matrix.T @ multipliers
    slack = problem.linear.matrix @ answer.z - problem.linear.bound
    gap = abs(float(multipliers @ slack))
    factor = safe_cholesky(problem.hessian(answer.z))
    if factor is None:
        return np.inf
    newton_step = cho_solve(factor, left)
    return float(np.sqrt(abs(left @ newton_step) + 2.0 * gap))


def entropic_estimate(
    method: str,
    rows: Regression,
    objective: Ridge,
    linear: LinearConstraints,
    settings: PullSettings,
    solver: EntropicSolver,
) -> Estimate:
    """Estimate with the entropic divergence; ``objective`` is the ridge with the pullback metric.

    Raises:
        NoSolutionError: no parameters meet the constraints, or an answer fails its recomputation.
    """
    source = rows.problem
    segments = moving_segments(source)
    relative = relative_map(source)
    maps = np.zeros((len(segments), 10, source.n_params))
    for place, k in enumerate(segments):
        maps[place, :, 10 * k : 10 * k + 10] = relative[k]
    turned = objective.rotate(maps.reshape(-1, source.n_params)).reshape(*maps.shape[:2], -1)
    weights = settings.alpha / (4.0 * settings.spreads(source.robot)[list(segments)] ** 2)
    problem = EntropicProblem(objective.target, turned, weights, objective.constraints(linear))
    answer = solver(problem)
    if answer is None:
        best = best_known(method, rows, objective, linear, [], problem.violations)
        raise no_solution(best.status, best)
    usable = np.isfinite(answer.z).all() and np.isfinite(answer.multipliers).all()
    inside = usable and np.linalg.eigvalsh(problem.relative(answer.z))[:, 0].min(initial=1.0) > 0.0
    distance = entropic_distance(problem, answer) if inside else np.inf
    best = checked_estimate(method, rows, objective, answer.z, distance, problem.linear)
    if best.status is not SolveStatus.SOLVED:
        known = best_known(method, rows, objective, linear, [answer.z], problem.violations)
        raise no_solution(best.status, replace(known, status=best.status))
    return best


# Primal-dual Newton method for the entropic divergence.

_STEPS = 400
_BACK = 0.97
_SHORT = 0.2
_SMALLEST = 1e-13
_FEASIBLE = 1e-7


@dataclass(frozen=True, eq=False)
class _Point:
    """Primal and dual variables: ``s`` slacks of inequalities with multipliers ``dual``, ``big`` duals of ``X``."""

    z: Array
    s: Array
    dual: Array
    nu: Array
    big: Array

    def moved(self, step: _Point, alpha: float) -> _Point:
        parts = zip(
            (self.z, self.s, self.dual, self.nu, self.big),
            (step.z, step.s, step.dual, step.nu, step.big),
            strict=True,
        )
        return _Point(*(old + alpha * change for old, change in parts))

    @property
    def finite(self) -> bool:
        return all(np.isfinite(part).all() for part in (self.z, self.s, self.dual, self.nu, self.big))


# Where no point meets the rows, multipliers grow until they overflow: that is looked at, not warned of.
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def newton_steps(problem: EntropicProblem) -> EntropicAnswer | None:
    """Primal-dual steps from the nominal model, which is inside; None where they find no feasible point.

    ``S`` stands for ``w X⁻¹`` and reaches it along a central path, as in semidefinite programming (Helmberg et
    al. 1996), so small weights converge as fast as large ones.
    """
    linear = problem.linear
    e, m = linear.n_equal, len(linear.bound) - linear.n_equal
    z = np.zeros(len(problem.target))
    s = np.maximum(linear.matrix[e:] @ z - linear.bound[e:], 1.0)
    big = np.maximum(problem.weights, 1.0)[:, None, None] * np.eye(4)
    point = _Point(z, s, 1.0 / s, np.zeros(e), big)
    size = max(1.0, float(np.linalg.norm(problem.target)))
    missed, cramped = np.inf, False
    for _ in range(_STEPS):
        system = _System.at(problem, point)
        if system is None:
            return None
        missed = float(max(np.abs(system.primal).max(initial=0.0), np.abs(system.tied).max(initial=0.0)))
        x = system.x
        after_x = np.einsum("bij,bji->b", x, point.big) / 4.0
        off = float(np.abs(x @ point.big - problem.weights[:, None, None] * np.eye(4)).max(initial=0.0))
        mu = float(point.s @ point.dual) / max(m, 1)
        if max(missed, float(np.abs(system.slope).max()), off, mu) < _SMALLEST * size:
            break
        level = max(mu, float((after_x - problem.weights).max(initial=0.0)))
        guess = system.step(np.zeros(m), problem.weights, None)
        if not guess.finite:
            break
        alpha = min(1.0, _longest_step(point, system, guess))
        if cramped:
            # Close to the boundary: back to the middle, without a correction that was meant for a long step.
            center, corrected = 0.5 * level, None
        else:
            center, corrected = max((1.0 - alpha) ** 3, 1e-4) * level, guess
        step = system.step(np.full(m, center), np.maximum(problem.weights, center), corrected)
        if not step.finite:
            break
        length = min(1.0, _BACK * _longest_step(point, system, step))
        point, cramped = point.moved(step, length), length <= _SHORT
    if not missed < _FEASIBLE:
        return None
    return EntropicAnswer(point.z, np.concatenate([point.nu, point.dual]))


@dataclass(frozen=True, eq=False)
class _System:
    """The optimality conditions linearised at a point."""

    problem: EntropicProblem
    point: _Point
    x: Array
    inverse: Array
    slope: Array
    primal: Array
    tied: Array
    factor: tuple[Array, bool]
    across: Array

    @classmethod
    def at(cls, problem: EntropicProblem, point: _Point) -> _System | None:
        shape, linear, n = triangle_of(4), problem.linear, len(point.z)
        e = linear.n_equal
        equal, rows = linear.matrix[:e], linear.matrix[e:]
        x = problem.relative(point.z)
        inverse = np.asarray(np.linalg.inv(x), dtype=float)
        pull = shape.vectors(problem.weights[:, None, None] * (2.0 * np.eye(4) - x) - point.big)
        slope = point.z - problem.target + np.tensordot(pull, problem.maps, 2)
        slope -= rows.T @ point.dual + equal.T @ point.nu
        product = np.einsum(
            "bij,ejk,bkl->beil", inverse, shape.matrices(np.eye(10)), point.big, optimize=True
        )
        curved = shape.vectors(0.5 * (product + product.swapaxes(2, 3)))
        curved -= problem.weights[:, None, None] * np.eye(10)
        blocks = curved.transpose(0, 2, 1) @ problem.maps
        normal = np.eye(n) + problem.maps.reshape(-1, n).T @ blocks.reshape(-1, n)
        factor = safe_cholesky(normal + rows.T @ ((point.dual / point.s)[:, None] * rows))
        if factor is None:
            return None
        return cls(
            problem,
            point,
            x,
            inverse,
            slope,
            rows @ point.z - linear.bound[e:] - point.s,
            equal @ point.z - linear.bound[:e],
            factor,
            cho_solve(factor, equal.T, check_finite=False),
        )

    def step(self, flat: Array, blocks: Array, guess: _Point | None) -> _Point:
        """Towards ``s·λ = flat`` and ``X S = blocks``; ``guess`` corrects to second order."""
        shape, p, point = triangle_of(4), self.problem, self.point
        e = p.linear.n_equal
        equal, rows = p.linear.matrix[:e], p.linear.matrix[e:]
        aim = flat - point.s * point.dual
        wish = blocks[:, None, None] * self.inverse - point.big
        if guess is not None:
            aim = aim - guess.s * guess.dual
            second = self.inverse @ shape.matrices(p.maps @ guess.z) @ guess.big
            wish = wish - 0.5 * (second + second.swapaxes(1, 2))
        inner = (aim - point.dual * self.primal) / point.s
        right = rows.T @ inner - self.slope + np.tensordot(shape.vectors(wish), p.maps, 2)
        free = cho_solve(self.factor, right, check_finite=False)
        nu = _solve_or_nan(equal @ self.across, -self.tied - equal @ free)
        dz = free + self.across @ nu
        ds = rows @ dz + self.primal
        product = self.inverse @ shape.matrices(p.maps @ dz) @ point.big
        big = wish - 0.5 * (product + product.swapaxes(1, 2))
        return _Point(dz, ds, (aim - point.dual * ds) / point.s, nu, big)


def _solve_or_nan(matrix: Array, right: Array) -> Array:
    """Solution of a linear system, NaN where rounding has made it singular: no step is taken then."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return np.full(len(right), np.nan)


def safe_cholesky(matrix: Array) -> tuple[Array, bool] | None:
    """Cholesky factor; the diagonal grows by a hair where rounding has made the matrix indefinite."""
    diagonal = np.diag_indices_from(matrix)
    for hair in (0.0, 1e-14, 1e-12, 1e-10, 1e-8):
        grown = matrix.copy()
        grown[diagonal] *= 1.0 + hair
        lower, info = dpotrf(grown, lower=True)
        if info == 0:
            return lower, True
    return None


def _longest_step(point: _Point, system: _System, step: _Point) -> float:
    """Longest step that keeps slacks, multipliers, ``X`` and ``S`` positive."""
    change = triangle_of(4).matrices(system.problem.maps @ step.z)
    lengths = [_longest_definite_step(system.x, change), _longest_definite_step(point.big, step.big)]
    for value, move in ((point.s, step.s), (point.dual, step.dual)):
        falling = move < 0.0
        lengths.append(float((-value[falling] / move[falling]).min(initial=np.inf)))
    return min(lengths)


def _longest_definite_step(matrices: Array, change: Array) -> float:
    """Longest step that keeps symmetric matrices positive definite."""
    eigen, vectors = np.linalg.eigh(matrices)
    root = vectors / np.sqrt(np.maximum(eigen, 1e-300))[:, None, :]
    least = float(np.linalg.eigvalsh(root.transpose(0, 2, 1) @ change @ root)[:, 0].min(initial=0.0))
    return -1.0 / least if least < 0.0 else np.inf


# Distances between bodies that depend on neither units nor frames (Lee, Wensing and Park 2020).
#
# The entropic divergence of pseudo-inertias, ``d(P‖P₀) = −log|P₀⁻¹P| + tr(P₀⁻¹P) − 4`` (their eq. 19), is the
# Bregman divergence of ``−log|P|``; the constant pullback distance ``½ tr((P₀⁻¹(P − P₀))²)`` is its second
# order. Both are divided by ``2σ²``, with σ the spread of the segment: a body that is heavier all over by the
# share σ costs one, as a parameter that is one spread off does in ``euclidean``.

# A nominal body that cannot exist, or is flat, is given this least eigenvalue of D J D.
_LEAST = 1e-6


def relative_map(problem: IdentificationProblem) -> Array:
    """``(n_segments, 10, 10)``: ten parameters to the ten entries of ``X = L⁻¹ P L⁻ᵀ`` with ``P₀ = L Lᵀ``.

    Of the nominal parameters it is the identity matrix.
    """
    nominal = pseudo_inertia_matrices(problem.prior[: problem.n_inertial])
    unit = np.concatenate([pseudo_inertia_matrices(row) for row in np.eye(10)])
    shape = triangle_of(4)
    scales = segment_scales(problem)
    maps = np.empty((len(nominal), 10, 10))
    for k, (pseudo, d) in enumerate(zip(nominal, scales, strict=True)):
        eigen, vectors = np.linalg.eigh(pseudo * np.outer(d, d))
        root = (vectors * np.sqrt(np.maximum(eigen, _LEAST))) @ vectors.T
        inverse = np.linalg.inv(root) * d
        maps[k] = shape.vectors(inverse @ unit @ inverse.T).T
    return maps


def pullback_metric(problem: IdentificationProblem, spreads: Array, scales: Array) -> Array:
    """``B`` with ``‖B (θ − θ₀)/s‖²`` the constant pullback distance over ``2σ²``; the identity for drives.

    Args:
        problem: the problem.
        spreads: σ of each segment ``(n_segments,)``.
        scales: ``s``, ``(n_params,)``.

    Returns:
        ``(n_params, n_params)``.
    """
    metric = np.eye(problem.n_params)
    for k, block in enumerate(relative_map(problem)):
        part = slice(10 * k, 10 * k + 10)
        metric[part, part] = block / (2.0 * spreads[k]) * scales[part]
    return metric


def entropic_divergence(parameters: Array, nominal: Array) -> Array:
    """``d(P‖P₀)`` of each segment, ``(n_segments,)``, infinite where a body cannot exist.

    Args:
        parameters: ``(10·n_segments,)``.
        nominal: ``(10·n_segments,)``, bodies that exist.
    """
    ratio = np.linalg.solve(pseudo_inertia_matrices(nominal), pseudo_inertia_matrices(parameters))
    least = np.linalg.eigvalsh(pseudo_inertia_matrices(parameters))[:, 0]
    value = np.trace(ratio, axis1=1, axis2=2) - np.linalg.slogdet(ratio)[1] - 4.0
    return np.where(least > 0.0, value, np.inf)
