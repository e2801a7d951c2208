"""Inertias are positive definite, linearised on vectors of the sphere (eq. 12–14 of Jovic et al., T-RO 2016).

``vᵀ I v ≥ ε`` is one linear row for each vector ``v`` and segment: 10 242 vectors and 30 segments would make
300 000 rows. They are added only where the last solution violates them (cutting planes), and in the end the
eigenvectors themselves stand in for the vectors that no finite set contains.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.identification.constraints.linear import LinearConstraints
from excite.identification.inertia import inertia_matrices
from excite.identification.problem import IdentificationProblem

_CUTS_PER_SEGMENT = 3


@cache
def icosphere_corners(subdivisions: int) -> Array:
    """Corners of an icosahedron whose faces are split in four ``subdivisions`` times, on the unit sphere.

    Returns:
        ``(10·4ⁿ + 2, 3)``; read only.
    """
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    corners = [(s, t * golden, 0.0) for s in (-1.0, 1.0) for t in (-1.0, 1.0)]
    corners = corners + [(0.0, a, b) for a, b, _ in corners] + [(b, 0.0, a) for a, b, _ in corners]
    points = np.array(corners) / np.sqrt(1.0 + golden**2)
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = np.isclose(distance, np.sort(distance[0])[1])
    faces = np.array(
        [
            (i, j, k)
            for i in range(12)
            for j in range(i + 1, 12)
            for k in range(j + 1, 12)
            if near[i, j] and near[j, k] and near[i, k]
        ]
    )
    for _ in range(subdivisions):
        points, faces = _split_faces(points, faces)
    points.setflags(write=False)
    return np.asarray(points)


def _split_faces(points: Array, faces: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    edges = np.sort(np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, index = np.unique(edges, axis=0, return_inverse=True)
    middle = points[unique].sum(axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    ab, bc, ca = (index.reshape(3, -1) + len(points)).astype(np.int64)
    a, b, c = faces.T
    corners = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    return np.vstack([points, middle]), np.vstack([np.column_stack(face) for face in corners])


def quadratic_rows(vectors: Array) -> Array:
    """Rows ``w`` with ``w · (Ixx, Ixy, Iyy, Ixz, Iyz, Izz) = vᵀ I v`` (eq. 14), ``(n, 6)``."""
    x, y, z = np.asarray(vectors).T
    return np.column_stack([x * x, 2 * x * y, y * y, 2 * x * z, 2 * y * z, z * z])


@dataclass(frozen=True, eq=False)
class InertiaCone:
    """Positive definiteness of every segment's inertia about its joint frame's origin.

    Attributes:
        problem: the problem.
        floor: ``ε`` of each segment ``(n_segments,)`` [kg·m²].
        subdivisions: subdivisions of the icosphere.
        skipped: segments whose parameters are not free.
    """

    problem: IdentificationProblem
    floor: Array
    subdivisions: int
    skipped: tuple[int, ...] = ()

    def cuts(self, parameters: Array, tolerance: float) -> LinearConstraints:
        """The rows that ``parameters`` violate most, at most three a segment; none when all hold.

        A segment that holds on every vector of the sphere and is still not positive definite is cut along
        its own eigenvector.

        Args:
            parameters: ``(n_params,)``.
            tolerance: violation that is let pass, as a share of ``floor``.
        """
        weights = quadratic_rows(icosphere_corners(self.subdivisions))
        six = parameters[: self.problem.n_inertial].reshape(-1, 10)[:, 4:]
        values = six @ weights.T
        eigenvalues, eigenvectors = np.linalg.eigh(inertia_matrices(parameters[: self.problem.n_inertial]))
        rows, bounds, labels = [], [], []
        for index, segment in enumerate(self.problem.robot.segments):
            floor = self.floor[index]
            if index in self.skipped or eigenvalues[index, 0] >= floor * (1.0 - tolerance):
                continue
            worst = np.argsort(values[index], kind="stable")[:_CUTS_PER_SEGMENT]
            worst = worst[values[index, worst] < floor * (1.0 - tolerance)]
            # Vectors and eigenvectors come with both signs; the row is the same.
            cut = weights[worst] if len(worst) else quadratic_rows(eigenvectors[index, :, :1].T)
            for weight in cut:
                row = np.zeros(self.problem.n_params)
                row[10 * index + 4 : 10 * index + 10] = weight
                rows.append(row)
                bounds.append(floor)
                labels.append(f"inertia_cone:{segment.link}")
        matrix = np.array(rows) if rows else np.zeros((0, self.problem.n_params))
        return LinearConstraints(matrix, np.array(bounds), tuple(labels))


def inertia_cone(problem: IdentificationProblem, relative_floor: float, subdivisions: int) -> InertiaCone:
    """The cone with ``ε`` a share of each nominal segment's least moment of inertia about any axis."""
    nominal = np.linalg.eigvalsh(inertia_matrices(problem.prior[: problem.n_inertial]))[:, 0]
    return InertiaCone(problem, relative_floor * np.maximum(nominal, 1e-9), subdivisions, problem.unmeasured)
