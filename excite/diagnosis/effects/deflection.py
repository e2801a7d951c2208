"""The motion of a link behind a soft or loose gear, and what it does to all torques."""

from __future__ import annotations

import math

import numpy as np

from excite.diagnosis.effects.effect import Context
from excite.lazy_kernel import LazyKernel
from excite.robot.robot import Array


@LazyKernel
def deflect(
    load, inertia, starts, dt, stiffness, damping, gap, cubic=0.0, soft=0.0
):  # pragma: no cover - compiled
    """Integrate ``M δ̈ = −τ − k(δ) − D δ̇`` with a dead band of ±gap, semi-implicitly.

    load, inertia: ``(n,)`` torque that the link needs and its inertia; ``starts`` marks the first sample of
    each trial, the first of all among them, where the deflection is the static one. The spring is
    ``k x (1 + cubic x²)``; in the dead band there is neither spring nor damper. With ``soft`` each flank of the band
    is ``k s log(1 + exp((x − gap)/s))``: contact comes on over a width s.
    Returns δ, δ̇, δ̈ as the rows of ``(3, n)``.
    """
    n = len(load)
    out = np.empty((3, n))
    first, lengths = _trials(starts)
    count, longest = len(first), 0
    # All trials go side by side: the processor works on several, where one would wait for itself.
    x, s, mean = np.empty(count), np.zeros(count), np.empty(count)
    now, then, m = np.empty(count), np.empty(count), np.empty(count)
    for k in range(count):
        now[k], longest = load[first[k]], max(longest, lengths[k])
        x[k] = _settled(-now[k] / stiffness, gap, cubic)
    h = dt / 4
    for i in range(longest):
        for k in range(count):
            # A trial that has ended goes on under its last load, unrecorded.
            here = first[k] + min(i, lengths[k] - 1)
            if i < lengths[k]:
                out[0, here], out[1, here] = x[k], s[k]
            now[k], m[k], mean[k] = load[here], inertia[here], 0.0
            then[k] = load[first[k] + min(i + 1, lengths[k] - 1)]
        for part in range(4):
            share = (part + 0.5) / 4
            for k in range(count):
                tau = now[k] * (1.0 - share) + then[k] * share
                if soft > 0.0:
                    held, share_held = _flanks(x[k], gap, soft)
                    kk, dd = stiffness * share_held, damping * share_held
                    force = -tau - stiffness * held - kk * h * s[k] - dd * s[k]
                else:
                    beyond = x[k] - gap if x[k] > gap else (x[k] + gap if x[k] < -gap else 0.0)
                    kk = stiffness * (1.0 + cubic * beyond * beyond) if beyond != 0.0 else 0.0
                    dd = damping if beyond != 0.0 else 0.0
                    force = -tau - kk * (beyond + h * s[k]) - dd * s[k]
                # Implicit in the spring and the damper: stable for any stiffness.
                acc = force / (m[k] + h * dd + h * h * kk)
                s[k] += h * acc
                x[k] += h * s[k]
                mean[k] += acc / 4
        for k in range(count):
            if i < lengths[k]:
                out[2, first[k] + i] = mean[k]
    return out


@LazyKernel
def _settled(stretch, gap, cubic):  # pragma: no cover - compiled
    """Deflection under a constant load, of which a linear spring would take ``stretch``."""
    x = stretch
    # Newton's method for x (1 + cubic x²) = stretch; from the softest spring's side it comes down.
    for _ in range(30):
        x -= (x * (1.0 + cubic * x * x) - stretch) / (1.0 + 3.0 * cubic * x * x)
    return x + gap if x > 0.0 else x - gap


@LazyKernel
def _flanks(x, gap, soft):  # pragma: no cover - compiled
    """Torque per stiffness of two soft contacts at ±gap, and its slope, 0…1."""
    up, down = (x - gap) / soft, (-x - gap) / soft
    held = soft * (math.log1p(math.exp(-abs(up))) + max(up, 0.0))
    held -= soft * (math.log1p(math.exp(-abs(down))) + max(down, 0.0))
    return held, 1.0 / (1.0 + math.exp(-up)) + 1.0 / (1.0 + math.exp(-down))


@LazyKernel
def _trials(starts):  # pragma: no cover - compiled
    """First sample and length of each trial, ``(n_trials,)`` both."""
    # Plain loops where numpy has a function: each of those takes a tenth of a second to compile.
    count = 0
    for marked in starts:
        count += marked
    first, lengths, end = np.empty(count, np.int64), np.empty(count, np.int64), len(starts)
    for i in range(len(starts) - 1, -1, -1):
        if starts[i]:
            count -= 1
            first[count], lengths[count], end = i, end - i, i
    return first, lengths


def link_inertia(context: Context, j: int) -> Array:
    """Inertia that a joint moves, ``(n_samples,)``, kept positive where fitted parameters make it none [kg·m²]."""
    key, kept = (j, "inertia"), context.baseline.derived.values
    if key not in kept:
        mass = context.gradient(j, "a")[:, j]
        kept[key] = np.maximum(mass, 0.05 * max(float(np.abs(mass).mean()), 1e-6))
    return kept[key]


def contact_stiffness(context: Context, j: int, hertz: float) -> float:
    """Stiffness at which the mean inertia behind a joint swings so often a second [N·m/rad]."""
    return float(link_inertia(context, j).mean()) * (2.0 * math.pi * hertz) ** 2


def gear_damping(context: Context, j: int, stiffness: float, ratio: float) -> float:
    """Damping of a gear whose ratio is told at the mean inertia behind it [N·m·s/rad]."""
    return 2.0 * ratio * math.sqrt(stiffness * float(link_inertia(context, j).mean()))


def response(
    context: Context,
    j: int,
    stiffness: float,
    ratio: float,
    gap: float,
    cubic: float = 0.0,
    soft: float = 0.0,
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
        soft: width over which contact comes on at either side of the play [rad].
    """
    load = context.baseline.rigid[:, j]
    mass = context.gradient(j, "a")
    inertia = link_inertia(context, j)
    starts = context.baseline.samples.starts
    damping = gear_damping(context, j, stiffness, ratio)
    rate = context.baseline.samples.rate_hz
    x, s, acc = deflect(load, inertia, starts, 1.0 / rate, stiffness, damping, gap, cubic, soft)
    by_q, by_v = context.gradient(j, "q"), context.gradient(j, "v")
    total = by_q * x[:, None] + by_v * s[:, None] + mass * acc[:, None]
    return {k: total[:, k] for k in range(total.shape[1])}
