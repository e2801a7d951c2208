"""The set of physical parameters that bounds and rules allow: convex in (m, mc, inertia about the CoM).

In these coordinates eq. (16) to (18) of Xu et al. 2020 are linear, all of them: the boxes of the centres of
mass as ``lower·m ≤ mc ≤ upper·m``, bounds and rules of the inertias in the inertias alone. Only the way from
here to the standard parameters (eq. 14, through ``hhᵀ/m``) is not.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from excite.arrays import Array, Indices
from excite.errors import NoSolutionError
from excite.identification.inertia import DIAGONAL, STEINER, second_moments
from excite.identification.parameter_statistics import eliminate_parameters
from excite.identification.physical.bounds import PhysicalBounds, least_density_moments
from excite.identification.physical.cone_program import ConeProgram, solve_cone_program

# How far inside the set answers are drawn, in scaled units: above rounding, of no weight in the objective.
_INSIDE = 1e-10


@dataclass(frozen=True, eq=False)
class FeasibleSet:
    """Coordinates ``x``: per free segment ``m, h = mc, inertia about the CoM`` (ten), then the drives.

    Attributes:
        bounds: bounds and rules of all segments, and bounds of all drives.
        drive_names: names of the drives' parameters, in their order.
        free: ``(n_free,)`` segments that may move.
        frozen: ``(10·n_segments,)`` standard parameters that the others keep.
    """

    bounds: PhysicalBounds
    drive_names: tuple[str, ...]
    free: Indices
    frozen: Array

    @property
    def n_body(self) -> int:
        """Number of coordinates of bodies."""
        return 10 * len(self.free)

    @property
    def drive_lower(self) -> Array:
        """Lower bounds of the drives' parameters, ``(n_drives,)``."""
        return np.array([self.bounds.drives[name][0] for name in self.drive_names])

    @property
    def drive_upper(self) -> Array:
        """Upper bounds of the drives' parameters, ``(n_drives,)``."""
        return np.array([self.bounds.drives[name][1] for name in self.drive_names])

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.n_body + len(self.drive_names)

    @cached_property
    def reach(self) -> Array:
        """Greatest size of each component of each centre of mass, ``(n_free, 3)`` [m]."""
        low, high = self.bounds.lower[self.free, 1:4], self.bounds.upper[self.free, 1:4]
        return np.asarray(np.maximum(np.abs(low), np.abs(high)))

    @cached_property
    def scale(self) -> Array:
        """Size of each coordinate, ``(size,)``."""
        mass, reach = self.bounds.upper[self.free, :1], self.reach.max(axis=1, keepdims=True)
        body = mass * reach ** np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
        return np.concatenate([body.ravel(), self.drive_upper - self.drive_lower])

    @property
    def rows(self) -> Array:
        """Rows ``A`` of ``A x ≥ b``, ``(k, size)``, each of unit length in scaled coordinates."""
        return self._linear[0]

    @property
    def bound(self) -> Array:
        """``b``, ``(k,)``."""
        return self._linear[1]

    @cached_property
    def _linear(self) -> tuple[Array, Array]:
        unit, parts, values = np.eye(10), [], []
        for k in self.free:
            low, high = self.bounds.lower[k], self.bounds.upper[k]
            rules = np.pad(self.bounds.rules.rows(self.bounds.links[k]), ((0, 0), (4, 0)))
            box = _box_rows(low[1:4], high[1:4])
            parts.append(np.vstack([unit[:1], -unit[:1], box, unit[4:], -unit[4:], rules]))
            values += [low[:1], -high[:1], np.zeros(6), low[4:], -high[4:], np.zeros(len(rules))]
        drives = np.eye(len(self.drive_names))
        total = np.zeros((1, self.size))
        total[0, : self.n_body : 10] = 1.0
        masses = self.frozen[::10]
        rest = float(masses.sum() - masses[self.free].sum())
        least, greatest = self.bounds.total_mass
        matrix = np.vstack([block_diag(*parts, np.vstack([drives, -drives])), total, -total])
        ends = [least - rest, rest - greatest]
        bound = np.concatenate([*values, self.drive_lower, -self.drive_upper, ends])
        length = np.linalg.norm(matrix * self.scale, axis=1)
        return matrix / length[:, None], bound / length

    def on_bodies(self, blocks: Iterable[Array]) -> Array:
        """Blocks ``(k, 10)`` that act on each free segment's coordinates, one below the other, ``(…, size)``."""
        return np.asarray(block_diag(*blocks, np.zeros((0, len(self.drive_names)))))

    def box_rows(self, low: Array, high: Array) -> Array:
        """Rows ``A x ≥ 0`` that keep the centres of mass in boxes ``(n_free, 3)``, ``(6·n_free, size)``."""
        return self.on_bodies(_box_rows(*box) for box in zip(low, high, strict=True))

    @cached_property
    def density(self) -> Array:
        """Triangles of ``½tr(I)·1 − I`` about the CoMs, scaled, that the rules keep PSD, ``(k, 6, size)``."""
        if not self.bounds.rules.principal_triangle:
            return np.zeros((0, 6, self.size))
        matrix = -np.eye(6, 10, 4)
        matrix[np.ix_(DIAGONAL, [4 + k for k in DIAGONAL])] += 0.5
        return self.on_bodies(matrix / size for size in self.scale[4 : self.n_body : 10]).reshape(
            -1, 6, self.size
        )

    def slack(self, x: Array) -> float:
        """Least slack of all constraints in scaled units; negative outside the set."""
        least = float((self.rows @ x - self.bound).min())
        if self.bounds.rules.principal_triangle:
            inertias = x[: self.n_body].reshape(-1, 10)[:, 4:]
            moments = least_density_moments(inertias) / self.scale[4 : self.n_body : 10]
            least = min(least, float(moments.min()))
        return least

    @cached_property
    def interior(self) -> Array:
        """A point far inside, ``(size,)``.

        Raises:
            NoSolutionError: bounds and rules contradict each other; ``best`` is the point ``(size,)`` that
                breaks them least, None where none was found.
        """
        deep = np.zeros((1, self.size + 1))
        deep[0, -1] = 1.0
        identity = np.zeros((len(self.density), 6, 1))
        identity[:, DIAGONAL] = -1.0
        answer = solve_cone_program(
            ConeProgram(
                matrix=deep,
                target=np.ones(1),
                rows=np.hstack([self.rows, -np.ones((len(self.rows), 1))]),
                bound=self.bound,
                cones=(np.concatenate([self.density, identity], axis=2),) if len(self.density) else (),
                weight=np.append(1e-4 / self.scale, 0.0),
                center=np.zeros(self.size + 1),
                scale=np.append(self.scale, 1.0),
            )
        )
        if answer is None or self.slack(answer.z[:-1]) <= 2.0 * _INSIDE:
            raise NoSolutionError(
                "bounds and rules of the physical parameters leave nothing between them",
                best=None if answer is None else answer.z[:-1],
                remedy="widen the bounds, the total mass or the rules of the inertias",
            )
        return answer.z[:-1]

    def nearest(self, x: Array) -> Array:
        """Point of the set nearest to ``x`` in scaled units, ``(size,)``."""
        nothing = np.zeros((0, self.size))
        return self.step(nothing, np.zeros(0), 1.0 / self.scale, x)

    def step(self, matrix: Array, target: Array, weight: Array, center: Array) -> Array:
        """Minimum over the set of ``½‖matrix·x − target‖² + ½‖weight∘(x − center)‖²``, drawn inside.

        Args:
            matrix: ``(m, size)``.
            target: ``(m,)``.
            weight: ``(size,)``.
            center: ``(size,)``.

        Returns:
            ``(size,)``; the interior point where the cone program has no answer.
        """
        cones = (self.density,) if len(self.density) else ()
        answer = solve_cone_program(
            ConeProgram(matrix, target, self.rows, self.bound, cones, weight, center, self.scale)
        )
        return self.interior if answer is None else self.inside(answer.z)

    def inside(self, x: Array) -> Array:
        """``x`` ``(size,)`` drawn inwards as little as is needed to meet every constraint with a margin."""
        slack = self.slack(x)
        if slack >= _INSIDE:
            return x
        # Slack is concave along the way, so that this share is always enough.
        share = (_INSIDE - slack) / (self.slack(self.interior) - slack)
        return x + min(1.0, 1.01 * share) * (self.interior - x)

    def moments(self, x: Array) -> Array:
        """Second moments ``hhᵀ/m`` of the free segments, ``(6·n_free,)``."""
        body = x[: self.n_body].reshape(-1, 10)
        return second_moments(body[:, 0], body[:, 1:4]).ravel()

    def standard(self, x: Array) -> Array:
        """Standard parameters and drives, ``(n_params,)`` (eq. 14)."""
        return np.asarray(self.lift @ np.concatenate([x, self.moments(x)]) + self.offset)

    @cached_property
    def lift(self) -> Array:
        """Standard parameters and drives as linear in ``(x, hhᵀ/m)``, ``(n_params, size + 6·n_free)``."""
        n, n_drives = len(self.frozen), len(self.drive_names)
        ten = (10 * self.free[:, None] + np.arange(10)).reshape(-1, 10)
        bodies, inertias = (np.eye(n)[:, places.ravel()] for places in (ten, ten[:, 4:]))
        matrix = np.zeros((n + n_drives, self.size + inertias.shape[1]))
        matrix[:n, : self.n_body] = bodies
        matrix[n:, self.n_body : self.size] = np.eye(n_drives)
        matrix[:n, self.size :] = inertias @ np.kron(np.eye(len(self.free)), STEINER)
        return matrix

    @cached_property
    def offset(self) -> Array:
        """What the frozen segments contribute, ``(n_params,)``."""
        fixed = self.frozen.reshape(-1, 10).copy()
        fixed[self.free] = 0.0
        return np.concatenate([fixed.ravel(), np.zeros(len(self.drive_names))])

    def coordinates(self, physical: Array, drives: Array) -> Array:
        """``x`` of physical parameters of all segments ``(n_segments, 10)`` and drives ``(n_drives,)``."""
        body = physical[self.free].copy()
        body[:, 1:4] *= body[:, :1]
        return np.concatenate([body.ravel(), drives])


def _box_rows(low: Array, high: Array) -> Array:
    """Rows on ten coordinates of a body of ``low·m ≤ h ≤ high·m``, ``(6, 10)``."""
    sides = np.vstack([np.column_stack([-low, np.eye(3)]), np.column_stack([high, -np.eye(3)])])
    return np.pad(sides, ((0, 0), (0, 6)))


# The objective of eq. (15) of Xu et al. 2020: torques that essential parameters leave unexplained.

# What Xu et al. 2020 call small [SI, units mixed].
VALUE_BELOW = 0.01


@dataclass(frozen=True, eq=False)
class TorqueObjective:
    """``f(θ)² = ‖factor·θ − target‖² + floor²``: eq. (15), condensed by a QR.

    Attributes:
        factor: ``(n_essential, n_params)``.
        target: ``(n_essential,)`` [N·m].
        floor: what no parameters explain [N·m].
        kept: ``(n_essential,)`` indices of the base parameters that are in it.
    """

    factor: Array
    target: Array
    floor: float
    kept: Indices

    def value(self, parameters: Array) -> float:
        """``f`` [N·m] of standard parameters and drives ``(n_params,)``."""
        rest = self.factor @ parameters - self.target
        return float(np.sqrt(rest @ rest + self.floor**2))


def base_objective(triangle: Array, matrix: Array) -> TorqueObjective:
    """``‖τ − Y_b π_b‖`` with all base parameters.

    Args:
        triangle: ``R`` of ``[Y_b τ] = Q R``, ``(n_base + 1, n_base + 1)``.
        matrix: base parameters as combinations of all parameters, ``(n_base, n_params)``.
    """
    n = len(matrix)
    return TorqueObjective(
        triangle[:n, :n] @ matrix, triangle[:n, n], abs(float(triangle[n, n])), np.arange(n)
    )


def essential_objective(triangle: Array, matrix: Array, n_rows: int) -> TorqueObjective:
    """``‖τ − Y_e π_e‖`` with the parameters left by the elimination at the end of section II.A, rows white.

    Args:
        triangle: ``R`` of ``[Y_b τ] = Q R``, ``(n_base + 1, n_base + 1)``.
        matrix: base parameters as combinations of all parameters, ``(n_base, n_params)``.
        n_rows: number of rows of ``Y_b``.
    """
    n = len(matrix)
    left = eliminate_parameters(
        triangle[:n, :n],
        triangle[:n, n],
        np.full(n, VALUE_BELOW),
        np.eye(n),
        squares=float(triangle[n, n]) ** 2,
        n_rows=n_rows,
    )
    return TorqueObjective(
        left.factor @ matrix[left.kept], left.rotated, float(np.sqrt(left.squares)), left.kept
    )
