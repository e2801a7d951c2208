"""Parameters as deviations from nominal in units of their spreads, and the ridge objective in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from excite.arrays import Array, Indices
from excite.identification.constraints.cones import Cones, segment_scales, triangle_of
from excite.identification.constraints.linear import LinearConstraints, unit_rows
from excite.identification.estimators.settings import EstimatorSettings, PullSettings
from excite.identification.inertia import pseudo_inertia_matrices
from excite.identification.problem import IdentificationProblem
from excite.identification.regression import Regression, prior_std, square_factor


@dataclass(frozen=True, eq=False)
class Scaled:
    """``θ = center + scales · x`` on the free parameters; the rest stays nominal.

    Attributes:
        center: nominal parameters ``(n_params,)``.
        scales: spreads ``(n_params,)``.
        free: ``(n_free,)`` indices.
    """

    center: Array
    scales: Array
    free: Indices

    def parameters(self, x: Array) -> Array:
        """``θ`` of ``x``, ``(n_params,)``."""
        theta = self.center.copy()
        theta[self.free] += self.scales[self.free] * x
        return theta

    def coordinates(self, parameters: Array) -> Array:
        """``x`` of ``θ``, ``(n_free,)``."""
        return np.asarray(((parameters - self.center) / self.scales)[self.free])

    def columns(self, matrix: Array) -> Array:
        """Columns that act on ``θ`` made to act on ``x``, ``(…, n_free)``."""
        return matrix[..., self.free] * self.scales[self.free]

    def constraints(self, rows: LinearConstraints) -> LinearConstraints:
        """The same constraints on ``x``, rows of unit length; rows without a free parameter left out."""
        bound = rows.bound - rows.matrix @ self.center
        return unit_rows(self.columns(rows.matrix), bound, rows.labels, rows.n_equal)


def scaled_parameters(rows: Regression, settings: EstimatorSettings) -> Scaled:
    """Scales from the spreads; parameters of unmeasured segments are not free."""
    problem = rows.problem
    scales = prior_std(problem, settings.spreads(problem.robot))
    return Scaled(problem.prior.copy(), scales, np.flatnonzero(problem.is_moving))


# The objective of eq. (4) of Jovic et al. 2015 as a distance, in scaled and rotated parameters.


@dataclass(frozen=True, eq=False)
class Ridge:
    """``‖W(Yθ − y)‖² + α ‖(θ − θ₀)/s‖² = ‖z − d‖² + const`` with ``z = R (θ − θ₀)/s``.

    The rows are divided by the noise's standard deviation and by the root of its integrated autocorrelation,
    the parameters by how far they may lie from nominal: at ``α = 1`` the minimum is the most probable model.
    In ``z`` the objective is a plain distance, so solvers meet no bad conditioning from it, and a duality
    gap bounds the distance to the optimum in standard deviations.

    Attributes:
        scaled: ``θ₀``, ``s`` and the parameters that may move.
        factor: ``R``, upper triangular ``(n_free, n_free)``.
        target: ``d``, ``(n_free,)``: the unconstrained optimum.
    """

    scaled: Scaled
    factor: Array
    target: Array

    def parameters(self, z: Array) -> Array:
        """``θ`` of ``z``, ``(n_params,)``."""
        return self.scaled.parameters(solve_triangular(self.factor, z, check_finite=False))

    def coordinates(self, parameters: Array) -> Array:
        """``z`` of ``θ``, ``(n_free,)``."""
        return self.factor @ self.scaled.coordinates(parameters)

    def rotate(self, rows: Array) -> Array:
        """Rows that act on ``θ`` made to act on ``z``, ``(n_rows, n_free)``."""
        return np.asarray(solve_triangular(self.factor, self.scaled.columns(rows).T, trans="T").T)

    def constraints(self, constraints: LinearConstraints) -> LinearConstraints:
        """The same constraints on ``z``, each row of unit length; rows without a free parameter left out."""
        bound = constraints.bound - constraints.matrix @ self.scaled.center
        return unit_rows(self.rotate(constraints.matrix), bound, constraints.labels, constraints.n_equal)

    def cones(self, cones: Cones) -> Cones:
        """The same cones on ``z``, each block divided by its own size."""
        blocks, size, _ = cones.matrix.shape
        flat = cones.matrix.reshape(blocks * size, -1)
        bound = cones.bound + (flat @ self.scaled.center).reshape(blocks, size)
        matrix = self.rotate(flat).reshape(blocks, size, -1)
        length = np.maximum(np.linalg.norm(matrix, axis=(1, 2)), 1e-300)
        return Cones(cones.order, matrix / length[:, None, None], bound / length[:, None], cones.labels)


def build_ridge(rows: Regression, settings: PullSettings, metric: Array | None = None) -> Ridge:
    """Build the objective from weighted rows; parameters of unmeasured segments are not free.

    Args:
        settings: α and spreads.
        metric: ``(n_params, n_params)``, ``B`` with ``‖B (θ − θ₀)/s‖²`` in place of ``‖(θ − θ₀)/s‖²``.
    """
    problem = rows.problem
    scaled = scaled_parameters(rows, settings)
    free = scaled.free
    data = rows.independent_factor
    data[:, -1] -= data[:, :-1] @ problem.prior
    tall = np.zeros((len(data) + len(free), len(free) + 1))
    tall[: len(data), :-1] = scaled.columns(data[:, :-1])
    tall[: len(data), -1] = data[:, -1]
    pull = np.eye(problem.n_params) if metric is None else metric
    tall[len(data) :, :-1] = np.sqrt(settings.alpha) * pull[np.ix_(free, free)]
    r = square_factor(tall)
    return Ridge(scaled, r[:-1, :-1], r[:-1, -1])


# Distances between bodies that depend on neither units nor frames (Lee, Wensing and Park 2020).
#
# The constant pullback distance ``½ tr((P₀⁻¹(P − P₀))²)`` is the second order of their entropic divergence of
# pseudo-inertias (eq. 19). It is divided by ``2σ²``, with σ the spread of the segment: a body that is heavier all over
# by the share σ costs one, as a parameter that is one spread off does in ``euclidean``.

# A nominal body that cannot exist, or is flat, is given this least eigenvalue of D J D.
_LEAST = 1e-6


def relative_map(problem: IdentificationProblem) -> Array:
    """``(n_segments, 10, 10)``: ten parameters to the ten entries of ``X = L⁻¹ P L⁻ᵀ`` with ``P₀ = L Lᵀ``.

    Of the nominal parameters it is the identity matrix.
    """
    nominal = pseudo_inertia_matrices(problem.prior[: problem.n_inertial])
    unit = pseudo_inertia_matrices(np.eye(10).ravel())
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
