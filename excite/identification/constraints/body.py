"""Bodies that can exist, as matrices that are positive semidefinite and linear in the ten parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.identification.constraints.cones import triangle_of
from excite.identification.inertia import inertia_matrices, pseudo_inertia_matrices
from excite.identification.problem import IdentificationProblem

# Answers lie this far inside the cone (of a matrix whose entries are about 1), so that a solver's or rounding's
# last digits leave them inside.
_INSIDE = 1e-8


@dataclass(frozen=True, eq=False)
class ParameterCones:
    """``matrix · θ + bound`` in cones, as :class:`~excite.identification.constraints.cones.Cones` on parameters.

    Attributes:
        order: of the matrices, 0 for second-order cones.
        matrix: ``(n_blocks, size, n_params)``.
        bound: ``(n_blocks, size)``.
        labels: ``kind:link`` of each block.
    """

    order: int
    matrix: Array
    bound: Array
    labels: tuple[str, ...]


def moving_segments(problem: IdentificationProblem) -> tuple[int, ...]:
    """Segments whose parameters are free."""
    return tuple(k for k in range(problem.n_inertial // 10) if k not in problem.unmeasured)


def segment_scales(problem: IdentificationProblem) -> Array:
    """``D = diag(1/(r√m), 1/(r√m), 1/(r√m), 1/√m)`` of each segment as ``(n_segments, 4)``.

    ``D J D`` of a hand is then as large as that of a trunk.
    """
    nominal = pseudo_inertia_matrices(problem.prior[: problem.n_inertial])
    mass = np.maximum(nominal[:, 3, 3], 1e-3)
    radius = np.sqrt(np.maximum(np.trace(nominal[:, :3, :3], axis1=1, axis2=2) / mass, 1e-4))
    return np.asarray(
        np.column_stack([1.0 / radius, 1.0 / radius, 1.0 / radius, np.ones(len(mass))])
        / np.sqrt(mass)[:, None]
    )


def pseudo_inertia_cones(problem: IdentificationProblem, floor: float) -> ParameterCones:
    """Every pseudo-inertia positive definite (Wensing, Kim and Slotine 2018): a density that is not negative.

    Args:
        problem: the problem.
        floor: the least eigenvalue stays above this share of the nominal one, both of ``D J D``.
    """
    unit = np.concatenate([pseudo_inertia_matrices(row) for row in np.eye(10)])
    nominal = pseudo_inertia_matrices(problem.prior[: problem.n_inertial])
    return _body_cones_of(problem, unit, nominal, segment_scales(problem), floor, "pseudo_inertia")


def feasibility_cones(problem: IdentificationProblem, floor: float) -> ParameterCones:
    """Mass positive and inertia about the centre of mass positive definite (eq. 3, Golluccio et al. 2020).

    ``[[L, S(h)ᵀ], [S(h), m·1]] ≻ 0`` says both by its Schur complement (Sousa and Cortesão 2014); the triangle
    inequality is not implied.
    """
    unit = np.concatenate([spatial_inertia_matrices(row) for row in np.eye(10)])
    nominal = spatial_inertia_matrices(problem.prior[: problem.n_inertial])
    scales = segment_scales(problem)[:, [0, 0, 0, 3, 3, 3]]
    return _body_cones_of(problem, unit, nominal, scales, floor, "feasible_inertia")


def spatial_inertia_matrices(parameters: Array) -> Array:
    """``[[L, S(h)ᵀ], [S(h), m·1]]`` of each segment, ``(n_segments, 6, 6)``; ``S`` is the cross product's matrix."""
    ten = np.asarray(parameters, dtype=float).reshape(-1, 10)
    full = np.zeros((len(ten), 6, 6))
    full[:, :3, :3] = inertia_matrices(parameters)
    skew = np.zeros((len(ten), 3, 3))
    x, y, z = ten[:, 1:4].T
    skew[:, 0, 1], skew[:, 0, 2], skew[:, 1, 2] = -z, y, -x
    skew -= skew.transpose(0, 2, 1)
    full[:, 3:, :3], full[:, :3, 3:] = skew, skew.transpose(0, 2, 1)
    full[:, 3:, 3:] = ten[:, 0, None, None] * np.eye(3)
    return full


def _body_cones_of(
    problem: IdentificationProblem, unit: Array, nominal: Array, scales: Array, floor: float, kind: str
) -> ParameterCones:
    order = unit.shape[1]
    shape = triangle_of(order)
    segments = moving_segments(problem)
    matrix = np.zeros((len(segments), shape.size, problem.n_params))
    bound = np.zeros((len(segments), shape.size))
    for place, k in enumerate(segments):
        scale = np.outer(scales[k], scales[k])
        matrix[place, :, 10 * k : 10 * k + 10] = shape.vectors(unit * scale).T
        least = floor * max(float(np.linalg.eigvalsh(nominal[k] * scale)[0]), 1e-6) + _INSIDE
        bound[place] = shape.vectors(-least * np.eye(order))
    labels = tuple(f"{kind}:{problem.robot.segments[k].link}" for k in segments)
    return ParameterCones(order, matrix, bound, labels)
