"""The motion of a link behind a soft or loose gear, and what it does to all torques."""

from __future__ import annotations

import math

import numpy as np

from excite.diagnosis.effects.effect import Context
from excite.lazy_kernel import LazyKernel
from excite.robot.robot import Array


@LazyKernel
def deflect(load, inertia, starts, dt, stiffness, damping, gap, cubic=0.0):  # pragma: no cover - compiled
    """Integrate ``M δ̈ = −τ − k(δ) − D δ̇`` with a dead band of ±gap, semi-implicitly.

    load, inertia: ``(n,)`` torque that the link needs and its inertia; ``starts`` marks the first sample of
    each trial, where the deflection is the static one. The spring is ``k x (1 + cubic x²)``; in the dead band
    there is neither spring nor damper.
    Returns δ, δ̇, δ̈ as the rows of ``(3, n)``.
    """
    n = len(load)
    out = np.zeros((3, n))
    x, s, acc = 0.0, 0.0, 0.0
    h = dt / 4
    for i in range(n):
        if starts[i]:
            x = -load[i] / stiffness
            # Newton's method for k x (1 + cubic x²) = −τ; from the softest spring's side it comes down.
            for _ in range(30):
                x -= (x * (1.0 + cubic * x * x) + load[i] / stiffness) / (1.0 + 3.0 * cubic * x * x)
            x = x + gap if x > 0.0 else x - gap
            s = 0.0
        out[0, i], out[1, i] = x, s
        mean = 0.0
        last = i if i + 1 >= n or starts[i + 1] else i + 1
        for k in range(4):
            share = (k + 0.5) / 4
            tau = load[i] * (1.0 - share) + load[last] * share
            m = inertia[i]
            beyond = x - gap if x > gap else (x + gap if x < -gap else 0.0)
            kk = stiffness * (1.0 + cubic * beyond * beyond) if beyond != 0.0 else 0.0
            dd = damping if beyond != 0.0 else 0.0
            # Implicit in the spring and the damper: stable for any stiffness.
            force = -tau - kk * (beyond + h * s) - dd * s
            acc = force / (m + h * dd + h * h * kk)
            s += h * acc
            x += h * s
            mean += acc / 4
        out[2, i] = mean
    return out


def link_inertia(context: Context, j: int) -> Array:
    """Inertia that a joint moves, ``(n_samples,)``, kept positive where fitted parameters make it none [kg·m²]."""
    mass = context.gradient(j, "a")[:, j]
    return np.maximum(mass, 0.05 * max(float(np.abs(mass).mean()), 1e-6))


def response(
    context: Context, j: int, stiffness: float, ratio: float, gap: float, cubic: float = 0.0
) -> dict[int, Array]:
    """Torques in all rows that a deflection of joint j adds, by row, ``(n_samples,)``.

    To first order in the deflection δ: ``∂τ/∂q δ + ∂τ/∂v δ̇ + M δ̈``, with δ from its own equation of
    motion, the other joints moving as logged (Spong 1987, eq. 5, with the motor's side prescribed).

    Args:
        context: the context.
        j: row of the joint.
        stiffness: of the gear, or of the contact on either side of the play [N·m/rad].
        ratio: damping ratio at the mean inertia.
        gap: half the play [rad].
        cubic: relative growth of the stiffness with the square of the deflection [1/rad²].
    """
    load = context.baseline.rigid[:, j]
    mass = context.gradient(j, "a")
    inertia = link_inertia(context, j)
    starts = np.zeros(len(load), dtype=np.bool_)
    starts[np.concatenate([[0], np.cumsum([len(t.time) for t in context.baseline.samples.trials])[:-1]])] = (
        True
    )
    damping = 2.0 * ratio * math.sqrt(stiffness * float(inertia.mean()))
    x, s, acc = deflect(
        load,
        inertia,
        starts,
        1.0 / context.baseline.samples.rate_hz,
        stiffness,
        damping,
        gap,
        cubic,
    )
    by_q, by_v = context.gradient(j, "q"), context.gradient(j, "v")
    total = by_q * x[:, None] + by_v * s[:, None] + mass * acc[:, None]
    return {k: total[:, k] for k in range(total.shape[1])}
