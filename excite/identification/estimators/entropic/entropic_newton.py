"""Primal-dual Newton method for the entropic divergence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve
from scipy.linalg.lapack import dpotrf

from excite.arrays import Array
from excite.identification.constraints.cones import triangle_of
from excite.identification.estimators.entropic.entropic_problem import EntropicAnswer, EntropicProblem

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
