"""Generalised-momentum observer: which external torque the joint torques betray (collision detection).

De Luca, Albu-Schäffer, Haddadin, Hirzinger, IROS 2006; Xu et al., IEEE Access 2020, compare parameter sets by its
largest residual (Table 10).
"""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.regressor.kernels import inverse_dynamics
from excite.regressor.tree import read_tree
from excite.robot.robot import Robot

# Half step of the derivative of the mass matrix [s]; its error is that of rounding, 1e-11 of the momentum.
_STEP = 1e-5


def observe_momentum(
    robot: Robot, time: Array, q: Array, v: Array, torque: Array, parameters: Array, *, gain: float
) -> Array:
    """Residual ``(n, nv)`` [N·m]: ``r = K (p − ∫(τ + Cᵀv − g + r) dt − p(0))`` with ``p = M v``.

    Without friction in ``torque`` and with true parameters, ``r`` follows the external torque through a first
    order lag, ``ṙ = K (τ_ext − r)``. Integrals by the trapezoidal rule; ``Cᵀv = Ṁv − Cv``, with ``Ṁv`` the derivative
    of ``M(q)v`` along ``v`` by central differences.
    """
    tree, still = read_tree(robot.model), np.zeros_like(v)

    def momentum(at: Array) -> Array:
        weight = inverse_dynamics(tree, at, still, still, parameters)
        return inverse_dynamics(tree, at, still, v, parameters) - weight

    # Cv + g is what holds the motion at no acceleration, so that Cᵀv − g = Ṁv − (Cv + g).
    change = (momentum(q + _STEP * v) - momentum(q - _STEP * v)) / (2.0 * _STEP)
    rate = change - inverse_dynamics(tree, q, v, still, parameters) + torque
    step = np.diff(time)
    gained = np.diff(momentum(q), axis=0) - 0.5 * step[:, None] * (rate[1:] + rate[:-1])
    residual, half = np.zeros_like(v), 0.5 * gain * step
    for k in range(len(step)):
        residual[k + 1] = ((1.0 - half[k]) * residual[k] + gain * gained[k]) / (1.0 + half[k])
    return residual
