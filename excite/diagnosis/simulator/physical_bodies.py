"""Bodies that can exist, as near to fitted inertial parameters as rows of a regressor can tell."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.identification.inertia import pseudo_inertia_matrices

_PRIOR = 1e-3
_ITERATIONS = 1500
_RELAXATION = 1.6
# Steps of the coordinates, which are of order one, that nothing is left to be found in.
_DONE = 1e-12
_NOTABLE = 1.0
# Least eigenvalue of a body's pseudo-inertia, relative to its nominal trace, lengths in its own radius.
_INSIDE = 1e-4
_UPPER = np.triu_indices(4)
_WEIGHT = np.where(_UPPER[0] == _UPPER[1], 1.0, np.sqrt(2.0))


class PhysicalBodies:
    """Bodies of positive density and drive terms that are not negative, in coordinates that need no units.

    A body's coordinates are its pseudo-inertia, lengths in its radius and masses in half its nominal one, stacked
    so that their Euclidean norm is the matrix's Frobenius norm: the nearest body is then a matter of eigenvalues.

    Attributes:
        map: ``(n, n)`` from coordinates to parameters.
    """

    def __init__(self, nominal: Array, drives: Array):
        mass = np.maximum(nominal.reshape(-1, 10)[:, 0], 0.02)
        pseudo = pseudo_inertia_matrices(nominal)
        radius = np.sqrt(np.trace(pseudo[:, :3, :3], axis1=1, axis2=2) / mass)
        self.size = len(nominal)
        self.inverse_radius = 1.0 / np.maximum(radius, 0.02)
        self.mass = 0.5 * mass
        blocks = [self._stacked(np.eye(10)[k]).T for k in range(10)]
        forward = np.stack(blocks, axis=2).transpose(1, 0, 2)
        total = np.zeros((self.size + len(drives),) * 2)
        for k, block in enumerate(forward):
            total[10 * k : 10 * k + 10, 10 * k : 10 * k + 10] = np.linalg.inv(block)
        total[self.size :, self.size :] = np.diag(drives)
        self.map = total
        self._inverse = np.linalg.inv(total)
        self.least = _INSIDE * np.trace(self._scaled(pseudo), axis1=1, axis2=2)

    def coordinates(self, x: Array) -> Array:
        """Coordinates of parameters ``(n,)``."""
        return self._inverse @ x

    def holds(self, y: Array) -> bool:
        """Whether these coordinates are those of bodies and drive terms that can be."""
        return bool(np.allclose(self.nearest(y), y, rtol=1e-9, atol=1e-9))

    def nearest(self, y: Array) -> Array:
        """Coordinates of the nearest bodies and drive terms."""
        out = np.maximum(y, 0.0)
        bodies = y[: self.size].reshape(-1, 10)
        full = np.zeros((len(bodies), 4, 4))
        full[:, _UPPER[0], _UPPER[1]] = full[:, _UPPER[1], _UPPER[0]] = bodies / _WEIGHT
        values, vectors = np.linalg.eigh(full)
        raised = np.maximum(values, self.least[:, None])
        near = np.einsum("kij,kj,klj->kil", vectors, raised, vectors)
        out[: self.size] = (near[:, _UPPER[0], _UPPER[1]] * _WEIGHT).ravel()
        return out

    def _scaled(self, pseudo: Array) -> Array:
        d = np.ones((len(pseudo), 4))
        d[:, :3] = self.inverse_radius[:, None]
        return pseudo * d[:, :, None] * d[:, None, :] / self.mass[:, None, None]

    def _stacked(self, ten: Array) -> Array:
        """Coordinates ``(n_segments, 10)`` of the same ten parameters in every segment."""
        pseudo = np.tile(pseudo_inertia_matrices(ten), (len(self.mass), 1, 1))
        return self._scaled(pseudo)[:, _UPPER[0], _UPPER[1]] * _WEIGHT


def nearest_bodies(bodies: PhysicalBodies, rows: Array, wish: Array, middle: Array) -> tuple[Array, float]:
    """Coordinates of the nearest physical bodies: rows weigh, nominal values break ties.

    Minimises ``|A (x − x̂)|²/m + λ |x − x_nominal|²`` over bodies of positive density and drive terms that are not
    negative, by the alternating direction method of multipliers (Boyd et al. 2011, section 3).

    Args:
        bodies: the set.
        rows: A ``(m, n)`` in its coordinates, each row in units of what it is known to.
        wish: x̂ ``(n,)``.
        middle: nominal values ``(n,)``.

    Returns:
        The coordinates, and by how much rows are off with them (RMS).
    """
    gram = rows.T @ rows / max(len(rows), 1)
    right = gram @ wish + _PRIOR * middle
    penalty = float(np.sqrt(_PRIOR * np.linalg.eigvalsh(gram)[-1]))
    inverse = np.linalg.inv(gram + (_PRIOR + penalty) * np.eye(len(wish)))
    z, u = bodies.nearest(wish), np.zeros(len(wish))
    for _ in range(_ITERATIONS):
        x = _RELAXATION * inverse @ (right + penalty * (z - u)) + (1.0 - _RELAXATION) * z
        last, z = z, bodies.nearest(x + u)
        u = u + x - z
        if max(np.abs(z - last).max(), np.abs(x - z).max()) < _DONE:
            break
    return z, float(np.sqrt(np.mean((rows @ (z - wish)) ** 2)))


def unphysical(mismatch: float, unit: str) -> tuple[str, ...]:
    """What is to be said of bodies that are off a fit by so many times a ``unit``; nothing where that is little."""
    if mismatch <= _NOTABLE:
        return ()
    return (
        "the fitted inertial parameters are no bodies' that can exist; the nearest ones are off by "
        f"{mismatch:.1f} times the {unit}",
    )
