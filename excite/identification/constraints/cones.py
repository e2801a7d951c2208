"""Affine maps into cones of symmetric positive semidefinite matrices and of vectors longer ahead than aside."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from excite.arrays import Array, Indices
from excite.errors import InputError
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.inertia import inertia_matrices, pseudo_inertia_matrices
from excite.identification.problem import IdentificationProblem


@dataclass(frozen=True, eq=False)
class Triangle:
    """Where the entries of a symmetric matrix lie in a vector: upper triangle by columns, off-diagonal √2.

    Attributes:
        rows: ``(k(k+1)/2,)``.
        columns: ``(k(k+1)/2,)``.
        root: ``(k(k+1)/2,)`` 1 on the diagonal, √2 elsewhere, so that scalar products are traces.
    """

    rows: Indices
    columns: Indices
    root: Array

    @property
    def size(self) -> int:
        """Number of entries."""
        return len(self.root)

    def vectors(self, matrices: Array) -> Array:
        """``(…, k, k)`` symmetric to ``(…, size)``."""
        return matrices[..., self.rows, self.columns] * self.root

    def matrices(self, vectors: Array) -> Array:
        """``(…, size)`` to ``(…, k, k)`` symmetric."""
        order = int(self.columns.max()) + 1
        full = np.empty((*vectors.shape[:-1], order, order))
        values = vectors / self.root
        full[..., self.rows, self.columns] = values
        full[..., self.columns, self.rows] = values
        return full

    def nearest_positive(self, vectors: Array) -> Array:
        """Vectors of the nearest positive semidefinite matrices, ``(…, size)``."""
        eigen, turn = np.linalg.eigh(self.matrices(vectors))
        return self.vectors((turn * np.maximum(eigen, 0.0)[..., None, :]) @ turn.swapaxes(-1, -2))


@cache
def triangle_of(order: int) -> Triangle:
    """The layout of ``order × order`` matrices."""
    columns = np.repeat(np.arange(order), np.arange(1, order + 1))
    rows = np.concatenate([np.arange(j + 1) for j in range(order)])
    return Triangle(rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0)))


@dataclass(frozen=True, eq=False)
class Cones:
    """Blocks of one kind: block ``i`` of ``matrix · z + bound`` lies in the cone.

    Attributes:
        order: of the matrices that are positive semidefinite; 0 for second-order cones of dimension 4, whose
            first entry is at least the length of the other three.
        matrix: ``(n_blocks, size, n)``, of coordinates ``z``, or of parameters.
        bound: ``(n_blocks, size)``.
        labels: what each block says, ``kind:segment``.
    """

    order: int
    matrix: Array
    bound: Array
    labels: tuple[str, ...]

    @property
    def size(self) -> int:
        """Entries a block."""
        return triangle_of(self.order).size if self.order else 4

    def values(self, z: Array) -> Array:
        """``matrix · z + bound``, ``(n_blocks, size)``."""
        return self.matrix @ z + self.bound

    def margin(self, values: Array) -> Array:
        """How far each block is inside, negative outside, ``(n_blocks,)``: least eigenvalue."""
        if self.order:
            return np.asarray(np.linalg.eigvalsh(triangle_of(self.order).matrices(values))[:, 0], dtype=float)
        return np.asarray(values[:, 0] - np.linalg.norm(values[:, 1:], axis=1), dtype=float)

    def projected(self, values: Array) -> Array:
        """Nearest points of the cone, ``(n_blocks, size)``."""
        if self.order:
            return triangle_of(self.order).nearest_positive(values)
        head, length = values[:, 0], np.linalg.norm(values[:, 1:], axis=1)
        half = 0.5 * (head + length)
        share = np.clip(half / np.where(length > 0.0, length, 1.0), 0.0, None)
        between = np.column_stack([half, values[:, 1:] * share[:, None]])
        inside, opposite = (length <= head)[:, None], (length <= -head)[:, None]
        return np.where(inside, values, np.where(opposite, 0.0, between))

    def derivative(self, values: Array) -> Array:
        """A derivative of ``projected`` at ``values``, ``(n_blocks, size, size)``."""
        return self._matrix_derivative(values) if self.order else self._vector_derivative(values)

    def _matrix_derivative(self, values: Array) -> Array:
        shape = triangle_of(self.order)
        eigen, vectors = np.linalg.eigh(shape.matrices(values))
        up = np.maximum(eigen, 0.0)
        difference = eigen[:, :, None] - eigen[:, None, :]
        same = np.abs(difference) < 1e-300
        share = np.where(
            same,
            (eigen[:, :, None] > 0.0),
            (up[:, :, None] - up[:, None, :]) / np.where(same, 1.0, difference),
        )
        unit = shape.matrices(np.eye(self.size))
        turned = np.einsum("bji,ejk,bkl->beil", vectors, unit, vectors, optimize=True) * share[:, None]
        back = np.einsum("bij,bejk,blk->beil", vectors, turned, vectors, optimize=True)
        return shape.vectors(back).transpose(0, 2, 1)

    def _vector_derivative(self, values: Array) -> Array:
        head, aside = values[:, 0], values[:, 1:]
        length = np.linalg.norm(aside, axis=1)
        safe = np.where(length > 0.0, length, 1.0)
        unit = aside / safe[:, None]
        outer = unit[:, :, None] * unit[:, None, :]
        derivative = np.zeros((len(values), 4, 4))
        derivative[:, 0, 0] = 0.5
        derivative[:, 0, 1:] = derivative[:, 1:, 0] = 0.5 * unit
        ratio = (head / safe)[:, None, None]
        derivative[:, 1:, 1:] = 0.5 * ((1.0 + ratio) * np.eye(3) - ratio * outer)
        derivative[length <= head] = np.eye(4)
        derivative[length <= -head] = 0.0
        return derivative


# Bodies that can exist, as matrices that are positive semidefinite and linear in the ten parameters.

# Answers lie this far inside the cone (of a matrix whose entries are about 1), so that a solver's or rounding's
# last digits leave them inside.
_INSIDE = 1e-8


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


def pseudo_inertia_cones(problem: IdentificationProblem, floor: float) -> Cones:
    """Every pseudo-inertia positive definite (Wensing, Kim and Slotine 2018): a density that is not negative.

    Args:
        floor: the least eigenvalue stays above this share of the nominal one, both of ``D J D``.
    """
    return _body_cones(problem, pseudo_inertia_matrices, segment_scales(problem), floor, "pseudo_inertia")


def feasibility_cones(problem: IdentificationProblem, floor: float) -> Cones:
    """Mass positive and inertia about the centre of mass positive definite (eq. 3, Golluccio et al. 2020).

    ``[[L, S(h)ᵀ], [S(h), m·1]] ≻ 0`` says both by its Schur complement (Sousa and Cortesão 2014); the triangle
    inequality is not implied.
    """
    scales = segment_scales(problem)[:, [0, 0, 0, 3, 3, 3]]
    return _body_cones(problem, spatial_inertia_matrices, scales, floor, "feasible_inertia")


def inertia_cones(problem: IdentificationProblem, floor: float) -> Cones:
    """Inertia about the joint frame's origin positive definite (eq. 12 of Jovic et al., T-RO 2016)."""
    return _body_cones(problem, inertia_matrices, segment_scales(problem)[:, :3], floor, "inertia_cone")


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


def _body_cones(
    problem: IdentificationProblem, of: Callable[[Array], Array], scales: Array, floor: float, kind: str
) -> Cones:
    """Matrices that are linear in each body's ten parameters stay above a share of the nominal ones."""
    unit, nominal = of(np.eye(10).ravel()), of(problem.prior[: problem.n_inertial])
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
    return Cones(order, matrix, bound, labels)


# Where a segment's centre of mass and its mass lie: ellipsoids (eq. 6, Golluccio et al. 2020; Wensing 2018).
#
# An ellipsoid is a matrix ``Q`` ``(4, 4)`` with ``[x; 1]ᵀ Q [x; 1] ≥ 0`` for its points ``x`` [m], in the
# joint frame of its segment.

# The nominal body stays inside with this margin: a share of the semi-axes, and of the mass.
_MARGIN = 0.1


def ellipsoid_matrix(center: Array, half: Array) -> Array:
    """``Q`` ``(n, 4, 4)`` of ellipsoids along the frame's axes from centres and semi-axes, both ``(n, 3)`` [m]."""
    inverse = 1.0 / np.asarray(half) ** 2
    q = np.zeros((len(inverse), 4, 4))
    q[:, [0, 1, 2], [0, 1, 2]] = -inverse
    q[:, :3, 3] = q[:, 3, :3] = inverse * center
    q[:, 3, 3] = 1.0 - (inverse * np.asarray(center) ** 2).sum(axis=1)
    return q


def com_ellipsoids(nominal: Array, boxes: Array) -> Array:
    """Ellipsoids inscribed in the boxes of the centres of mass, grown until the nominal ones are inside.

    Args:
        nominal: ``(10·n_segments,)`` parameters of the model.
        boxes: lower and upper corners, ``(n_segments, 2, 3)`` [m].

    Returns:
        ``(n_segments, 4, 4)``.
    """
    ten = nominal.reshape(-1, 10)
    mass = ten[:, :1]
    center, half = boxes.mean(axis=1), 0.5 * (boxes[:, 1] - boxes[:, 0])
    com = np.where(mass > 0.0, ten[:, 1:4] / np.where(mass > 0.0, mass, 1.0), center)
    reach = np.linalg.norm((com - center) / half, axis=1) * (1.0 + _MARGIN)
    return ellipsoid_matrix(center, half * np.maximum(reach, 1.0)[:, None])


def body_ellipsoids(nominal: Array, boxes: Array) -> Array:
    """Least ellipsoids around the boxes, grown until the nominal bodies' mass fits into them.

    Args:
        nominal: ``(10·n_segments,)`` parameters of the model.
        boxes: boxes that contain the bodies, lower and upper corners, ``(n_segments, 2, 3)`` [m].

    Returns:
        ``(n_segments, 4, 4)``.
    """
    center, half = boxes.mean(axis=1), np.sqrt(3.0) * 0.5 * (boxes[:, 1] - boxes[:, 0])
    pseudo = pseudo_inertia_matrices(nominal)
    mass = pseudo[:, 3, 3]
    value = np.einsum("sij,sij->s", pseudo, ellipsoid_matrix(center, half))
    share = np.where(mass > 0.0, (mass - value) / np.where(mass > 0.0, mass, 1.0), 0.0)
    growth = np.sqrt(np.maximum(share / (1.0 - _MARGIN), 1.0))
    return ellipsoid_matrix(center, half * growth[:, None])


def com_in_ellipsoids(problem: IdentificationProblem, ellipsoids: Array) -> Cones:
    """``‖A (h − m c)‖ ≤ m`` with ``AᵀA`` the ellipsoid's shape about its centre ``c`` (eq. 6).

    Raises:
        InputError: a matrix that is not that of an ellipsoid; names its segment.
    """
    segments = moving_segments(problem)
    matrix = np.zeros((len(segments), 4, problem.n_params))
    labels = []
    for place, k in enumerate(segments):
        link = problem.robot.segments[k].link
        shape, center = _ellipsoid_shape(ellipsoids[k], link)
        matrix[place, 0, 10 * k] = 1.0
        matrix[place, 1:, 10 * k] = -shape @ center
        matrix[place, 1:, 10 * k + 1 : 10 * k + 4] = shape
        labels.append(f"com_ellipsoid:{link}")
    return Cones(0, matrix, np.zeros((len(segments), 4)), tuple(labels))


def _ellipsoid_shape(q: Array, link: str) -> tuple[Array, Array]:
    """``A`` and centre of an ellipsoid."""
    eigen, vectors = np.linalg.eigh(-q[:3, :3])
    size = 0.0
    if np.isfinite(q).all() and eigen[0] > 0.0:
        center = np.linalg.solve(-q[:3, :3], q[:3, 3])
        size = float(q[3, 3] + q[:3, 3] @ center)
    if not size > 0.0:
        raise InputError(
            "is no ellipsoid",
            source="settings",
            field=f"ellipsoid of {link}",
            remedy="give [x; 1]ᵀ Q [x; 1] ≥ 0",
        )
    return (vectors * np.sqrt(eigen / size)) @ vectors.T, np.asarray(center, dtype=float)


def mass_in_ellipsoids(problem: IdentificationProblem, ellipsoids: Array) -> LinearConstraints:
    """``tr(J Q) ≥ 0``: with ``J ⪰ 0``, a density inside the ellipsoid has these parameters (Wensing et al. 2018)."""
    segments = moving_segments(problem)
    unit = pseudo_inertia_matrices(np.eye(10).ravel())
    matrix = np.zeros((len(segments), problem.n_params))
    for place, k in enumerate(segments):
        matrix[place, 10 * k : 10 * k + 10] = np.einsum("pij,ij->p", unit, ellipsoids[k])
    labels = tuple(f"body_ellipsoid:{problem.robot.segments[k].link}" for k in segments)
    return LinearConstraints(matrix, np.zeros(len(segments)), labels)
