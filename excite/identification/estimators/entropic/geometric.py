"""Distances between bodies that depend on neither units nor frames (Lee, Wensing and Park 2020).

The entropic divergence of pseudo-inertias, ``d(P‖P₀) = −log|P₀⁻¹P| + tr(P₀⁻¹P) − 4`` (their eq. 19), is the
Bregman divergence of ``−log|P|``; the constant pullback distance ``½ tr((P₀⁻¹(P − P₀))²)`` is its second order.
Both are divided by ``2σ²``, with σ the spread of the segment: a body that is heavier all over by the share σ
costs one, as a parameter that is one spread off does in ``euclidean``.
"""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.identification.constraints.body import segment_scales
from excite.identification.constraints.cones import triangle_of
from excite.identification.inertia import pseudo_inertia_matrices
from excite.identification.problem import IdentificationProblem

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
