"""Affine maps into cones of symmetric positive semidefinite matrices and of vectors longer ahead than aside."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array


@dataclass(frozen=True, eq=False)
class Triangle:
    """Where the entries of a symmetric matrix lie in a vector: upper triangle by columns, off-diagonal √2.

    Attributes:
        rows: ``(k(k+1)/2,)``.
        columns: ``(k(k+1)/2,)``.
        root: ``(k(k+1)/2,)`` 1 on the diagonal, √2 elsewhere, so that scalar products are traces.
    """

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
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
        matrix: ``(n_blocks, size, n)``.
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
            shape = triangle_of(self.order)
            eigen, vectors = np.linalg.eigh(shape.matrices(values))
            return shape.vectors((vectors * np.maximum(eigen, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1))
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
