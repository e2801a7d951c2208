"""What any motion of an arm could tell at most: the D-optimal design over states within its limits.

The log-determinant of the information a sample cannot be larger than that of the best measure over states (q, v, a), as
every motion's samples are such a measure. Kiefer and Wolfowitz 1960: for any information matrix M of p parameters the
best one's log-determinant is at most ``log det M + p log(max s / p)``, with ``s`` the trace of ``Y M⁻¹ Yᵀ`` of a state.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from excite.arrays import Array, Flags
from excite.excitation.design_rows import SEARCH_HZ, ArmRows
from excite.motion.motion import Motion
from excite.regressor.adjoint import regressor_gradient
from excite.regressor.kernels import joint_torque_regressor
from excite.threads import one_blas_thread

# States that an ascent starts from, rounds, and steps in each. Twice the states take twice the time (UR10 4, Panda 6
# seconds) and move the bound by 0.003 and 0.02 nats a parameter; half the rounds leave it 0.04 higher.
_STARTS, _ROUNDS, _STEPS = 125, 8, 30
# Multiplicative updates of the weights in a round (Silvey et al. 1978).
_UPDATES = 60


class _States:
    """States as vectors of shares of their limits, in [-1, 1]."""

    def __init__(self, rows: ArmRows) -> None:
        self.rows, limits = rows, rows.robot.limits
        half = 0.5 * (limits.position_upper - limits.position_lower)
        nothing = np.zeros_like(half)
        self._unit = np.concatenate([half, limits.velocity, limits.acceleration])
        self._centre = np.concatenate([limits.position_lower + half, nothing, nothing])

    def draw(self, rng: np.random.Generator, count: int) -> Array:
        """States far from rest: accelerations at their limits, velocities near them."""
        n = self.rows.robot.n_joints
        either = rng.choice([-1.0, 1.0], (2, count, n))
        speed = rng.uniform(0.0, 1.0, (count, n)) ** 0.3
        return np.hstack([rng.uniform(-1.0, 1.0, (count, n)), either[0] * speed, either[1]])

    def weighted(self, states: Array) -> tuple[Array, Flags]:
        """Weighted rows ``(m, n_joints, n_base)``, and which states the drives' torques allow, ``(m,)``."""
        q, v, a = self._split(states)
        full = joint_torque_regressor(self.rows.tree, q, v, a)
        torque = np.abs(self.rows.torques(full, v, a, np.sign(v)))
        allowed = np.asarray((torque <= self.rows.robot.limits.torque).all(axis=1))
        return self.rows.weighted(full, v, a, np.sign(v)), allowed

    def climb(self, states: Array, inverse: Array) -> Array:
        """States of larger ``tr(Y M⁻¹ Yᵀ)`` near others, each by steps of its own length."""
        value, slope = self._trace(states, inverse)
        step = np.full(len(states), 0.3)
        for _ in range(_STEPS):
            way = slope / np.maximum(np.abs(slope).max(axis=1, keepdims=True), 1e-12)
            tried = np.clip(states + step[:, None] * way, -1.0, 1.0)
            found, slope_there = self._trace(tried, inverse)
            better = found > value
            states, slope = (
                np.where(better[:, None], new, old) for new, old in ((tried, states), (slope_there, slope))
            )
            value, step = np.where(better, found, value), np.where(better, 1.4, 0.4) * step
        return states

    def _trace(self, states: Array, inverse: Array) -> tuple[Array, Array]:
        q, v, a = self._split(states)
        full = joint_torque_regressor(self.rows.tree, q, v, a)
        weighted = self.rows.weighted(full, v, a, np.sign(v))
        solved = weighted @ inverse
        weights, by_v, by_a, _ = self.rows.pulled(2.0 * solved, np.zeros_like(v), full.shape[2])
        gradient = regressor_gradient(self.rows.tree, q, v, a, weights)
        slope = np.hstack([gradient.q, gradient.v + by_v, gradient.a + by_a]) * self._unit
        return (solved * weighted).sum(axis=(1, 2)), slope

    def _split(self, states: Array) -> list[Array]:
        return np.split(self._centre + self._unit * states, 3, axis=1)


@one_blas_thread
def bound_log_det(rows: ArmRows, seed: int = 0) -> float:
    """The most that ``log det`` of the information a sample can be, of any motion within the limits of an arm.

    Joint positions, velocities, accelerations and drive torques are bounded. Collisions, jerk, and that states follow
    one another are left out, so that no motion gets there; the largest ``s`` is searched for by ascent from many
    states, so that it is a numerical bound and no proof.

    Args:
        rows: of the arm.
        seed: of the states that the search starts from.
    """
    rng, states = np.random.default_rng(seed), _States(rows)
    drawn = states.draw(rng, 2 * _STARTS)
    weighted, allowed = states.weighted(drawn)
    found, weighted = drawn[allowed], weighted[allowed]
    weight, best = np.full(len(found), 1.0 / len(found)), np.inf
    for _ in range(_ROUNDS):
        n_base = weighted.shape[2]
        for _ in range(_UPDATES):
            information = np.einsum("b,bri,brj->ij", weight, weighted, weighted, optimize=True)
            inverse = np.linalg.inv(information)
            weight = weight * ((weighted @ inverse) * weighted).sum(axis=(1, 2)) / n_base
            weight /= weight.sum()
        start = np.vstack([found[np.argsort(-weight)[:_STARTS]], states.draw(rng, _STARTS // 2)])
        top = states.climb(start, inverse)
        rows_there, allowed = states.weighted(top)
        trace = ((rows_there @ inverse) * rows_there).sum(axis=(1, 2))
        trace[~allowed] = 0.0
        largest = max(float(trace.max()), float(n_base))
        best = min(best, float(np.linalg.slogdet(information)[1]) + n_base * np.log(largest / n_base))
        kept, new = weight > 1e-5 * weight.max(), np.argsort(-trace)[: min(_STARTS, int(allowed.sum()))]
        found = np.vstack([found[kept], top[new]])
        weighted = np.concatenate([weighted[kept], rows_there[new]])
        share = 0.2 if len(new) else 0.0
        weight = np.concatenate(
            [(1.0 - share) * weight[kept] / weight[kept].sum(), np.full(len(new), share / max(len(new), 1))]
        )
    return best


@one_blas_thread
def d_efficiency(rows: ArmRows, motions: Sequence[Motion], bound: float) -> float:
    """``exp((log det M − bound)/p)`` of motions' information a sample: 0.2 takes five times the least seconds."""
    sampled = [motion.resampled(rows.robot, SEARCH_HZ) for motion in motions]
    q, v, a = (np.concatenate([getattr(one, name) for one in sampled]) for name in "qva")
    information = rows.information(q, v, a) / len(q)
    return float(np.exp((np.linalg.slogdet(information)[1] - bound) / len(information)))
