"""A convex relaxation of the retrieval: its minimum bounds the objective of every allowed robot from below.

The products ``H = hhᵀ/m`` become variables of their own with ``[[H, h], [hᵀ, m]] ⪰ 0`` and with the four
products of the sides of each centre of mass's box (McCormick 1976, multiplied by the mass), for example
``(h_p − l_p m)(u_q m − h_q)/m ≥ 0``. The smaller the boxes, the tighter the bound.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.identification.physical.cone_program import TRIANGLE, ConeProgram, solve_cone_program
from excite.identification.physical.coordinates import COLUMNS, ROWS, STEINER
from excite.identification.physical.feasible_set import FeasibleSet
from excite.identification.physical.objective import TorqueObjective


@dataclass(frozen=True, eq=False)
class Relaxed:
    """What the relaxation says of robots whose centres of mass lie in given boxes.

    Attributes:
        bound: no such robot has an objective below this [N·m], recomputed from the multipliers.
        x: ``(size,)`` coordinates in the feasible set.
        excess: ``H − hhᵀ/m`` of each free segment, ``(n_free, 6)`` [kg·m²]: 0 where the relaxation is exact.
    """

    bound: float
    x: Array
    excess: Array


@dataclass(frozen=True, eq=False)
class Relaxation:
    """The relaxation of one problem.

    Attributes:
        objective: what is to be small.
        allowed: the set of allowed parameters.
        weight: of the pull towards ``center``, which picks one of equally good robots, ``(size,)``.
        center: ``(size,)``.
    """

    objective: TorqueObjective
    allowed: FeasibleSet
    weight: Array
    center: Array

    def solve(self, low: Array, high: Array) -> Relaxed | None:
        """Relax with boxes of the centres of mass ``(n_free, 3)`` [m]; None where nothing lies in them."""
        allowed, n_moments = self.allowed, 6 * len(self.allowed.free)
        lifted = self._lifted_scale()
        pad = np.zeros((1, n_moments))
        rows = np.vstack([allowed.rows, allowed.box_rows(low, high)])
        rows = np.hstack([rows, np.repeat(pad, len(rows), axis=0)])
        products = self._products(low, high)
        rows = np.vstack([rows, products])
        bound = np.concatenate([allowed.bound, np.zeros(len(rows) - len(allowed.bound))])
        density = np.concatenate([allowed.density, np.zeros((len(allowed.density), 6, n_moments))], axis=2)
        program = ConeProgram(
            matrix=self.objective.factor @ allowed.lift,
            target=self.objective.target - self.objective.factor @ allowed.offset,
            rows=rows,
            bound=bound,
            cones=(self._moment_cones(), *((density,) if len(density) else ())),
            weight=np.concatenate([self.weight, np.zeros(n_moments)]),
            center=np.concatenate([self.center, np.zeros(n_moments)]),
            scale=lifted,
        )
        answer = solve_cone_program(program)
        if answer is None:
            return None
        x, moments = answer.z[: allowed.size], answer.z[allowed.size :]
        inside = allowed.inside(x)
        return Relaxed(
            bound=self._bound(program, answer.z, answer.linear, answer.cones),
            x=inside,
            excess=(moments - allowed.moments(inside)).reshape(-1, 6),
        )

    def _bound(self, program: ConeProgram, z: Array, linear: Array, cones: tuple[Array, ...]) -> float:
        """Lower bound from multipliers, whatever solver they came from.

        For every ``z`` that is allowed, ``½‖r‖² ≥ yᵀr − ½‖y‖²`` and the multipliers' terms are not negative:
        ``½‖r‖² ≥ −½‖y‖² − yᵀd + λᵀb + wᵀz`` with ``w`` what is left of stationarity, whose least value over
        the box around all allowed ``z`` is taken (Jansson 2004).
        """
        y = program.matrix @ z - program.target
        w = program.matrix.T @ y - program.rows.T @ linear
        for cone, dual in zip(program.cones, cones, strict=True):
            w -= np.einsum("ktn,kt->n", cone, dual)
        low, high = self._corners()
        least = float(np.minimum(w * low, w * high).sum())
        half = float(linear @ program.bound - y @ program.target - 0.5 * y @ y) + least
        return float(np.sqrt(max(2.0 * half, 0.0) + self.objective.floor**2))

    def _lifted_scale(self) -> Array:
        inertia = self.allowed.scale[4 : self.allowed.n_body : 10]
        return np.concatenate([self.allowed.scale, np.repeat(inertia, 6)])

    def _corners(self) -> tuple[Array, Array]:
        """Lower and upper corner of a box around all allowed ``(x, H)``."""
        allowed = self.allowed
        low, high = allowed.bounds.lower[allowed.free], allowed.bounds.upper[allowed.free]
        first = high[:, :1] * allowed.reach
        moments = (high[:, :1] * allowed.reach[:, ROWS] * allowed.reach[:, COLUMNS]).ravel()
        lower = np.hstack([low[:, :1], -first, low[:, 4:]]).ravel()
        upper = np.hstack([high[:, :1], first, high[:, 4:]]).ravel()
        return (
            np.concatenate([lower, allowed.drive_lower, -moments]),
            np.concatenate([upper, allowed.drive_upper, moments]),
        )

    def _moment_cones(self) -> Array:
        """``[[H, h], [hᵀ, m]]`` of each free segment, scaled to its size, ``(n_free, 10, n)``."""
        allowed = self.allowed
        rows = np.zeros((len(allowed.free), 10, allowed.size + 6 * len(allowed.free)))
        for place in range(len(allowed.free)):
            body, moments = 10 * place, allowed.size + 6 * place
            mass, first = allowed.scale[body], allowed.scale[body + 1]
            for k, (i, j) in enumerate(TRIANGLE):
                if j < 3:
                    rows[place, k, moments + k] = mass / first**2
                elif i < 3:
                    rows[place, k, body + 1 + i] = 1.0 / first
                else:
                    rows[place, k, body] = 1.0 / mass
        return rows

    def _products(self, low: Array, high: Array) -> Array:
        """Products of the sides of the boxes, rows ``≥ 0`` of unit length in scaled units."""
        allowed, found = self.allowed, []
        for place in range(len(allowed.free)):
            body, moments = 10 * place, allowed.size + 6 * place
            near, far = low[place], high[place]
            for k, (p, q) in enumerate(zip(ROWS, COLUMNS, strict=True)):
                # ±(h_p − s m)(h_q − t m)/m ≥ 0
                sides = [(1.0, near[p], near[q]), (1.0, far[p], far[q]), (-1.0, near[p], far[q])]
                if p != q:
                    sides.append((-1.0, far[p], near[q]))
                for sign, s, t in sides:
                    row = np.zeros(allowed.size + 6 * len(allowed.free))
                    row[moments + k] = sign
                    row[body + 1 + p] -= sign * t
                    row[body + 1 + q] -= sign * s
                    row[body] += sign * s * t
                    found.append(row)
        rows = np.array(found)
        return np.asarray(rows / np.linalg.norm(rows * self._lifted_scale(), axis=1, keepdims=True))

    def completed(self, relaxed: Relaxed) -> Array | None:
        """The relaxed robot with the excess second moments made part of its bodies, ``(size,)``, None if not allowed.

        It then has the relaxation's objective: nothing is better.
        """
        x = relaxed.x.copy()
        body = x[: self.allowed.n_body].reshape(-1, 10)
        body[:, 4:] += relaxed.excess @ STEINER.T
        return self.allowed.inside(x) if self.allowed.slack(x) > -1e-7 else None
