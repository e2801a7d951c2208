"""The motion of a link behind a soft or loose gear."""

from __future__ import annotations

import math

import numpy as np

from excite.lazy_kernel import LazyKernel

# No gear gives way further [rad].
_FURTHEST = 1.0


@LazyKernel
def deflect(behind, gear, starts, begin, dt):  # pragma: no cover - compiled
    """Integrate ``M δ̈ = −τ(δ, δ̇) − k(δ) − D δ̇`` with a dead band of ±gap, by its midpoints.

    ``behind`` (:class:`~excite.diagnosis.effects.gears.gear.Behind`) is the torque τ that the link needs and what it
    changes with. The inertia behind a joint does not change with its own angle, and so nothing does with the square of
    its own speed. ``starts`` marks the first sample of each trial, the first of all among them, where the deflection is
    the static one and ``begin (n_trials, 2)`` more, angle and speed.

    ``gear`` (:class:`~excite.diagnosis.effects.gears.gear.Gear`) gives way: the spring is ``k x (1 + cubic x²)``; in
    the dead band there is neither spring nor damper. With ``soft`` each flank of the band is
    ``k s log(1 + exp((x − gap)/s))``: contact comes on over a width s. With ``depth`` the flanks are round, their
    force and their damping as those of two spheres: ``k x √(x/depth)`` (Hertz 1881; Hunt, Crossley 1975). Contacts
    push and do not pull.
    Returns δ, δ̇, δ̈ as the rows of ``(3, n)``.
    """
    load, stiffness, gap, cubic = behind.load, gear.stiffness, gear.gap, gear.cubic
    n = len(load)
    out = np.empty((3, n))
    first, lengths = _trials(starts)
    count, longest = len(first), 0
    # All trials go side by side: the processor works on several, where one would wait for itself.
    x, s, mean = np.empty(count), np.empty(count), np.empty(count)
    now, then, m = np.empty(count), np.empty(count), np.empty(count)
    turn, drag = np.empty(count), np.empty(count)
    bend, twist = np.empty(count), np.empty(count)
    for k in range(count):
        now[k], longest = load[first[k]], max(longest, lengths[k])
        # A load that falls as the link gives way softens the gear; it is not let carry all of it.
        held = max(1.0 + behind.by_q[first[k]] / stiffness, 0.2)
        x[k] = _settled(-now[k] / (stiffness * held), gap, cubic / held) + begin[k, 0]
        s[k] = begin[k, 1]
    h = dt / 4
    for i in range(longest):
        for k in range(count):
            # A trial that has ended goes on under its last load, unrecorded.
            here = first[k] + min(i, lengths[k] - 1)
            if i < lengths[k]:
                out[0, here], out[1, here] = x[k], s[k]
            now[k], m[k], mean[k] = load[here], behind.inertia[here], 0.0
            turn[k], drag[k] = behind.by_q[here], behind.by_v[here]
            bend[k], twist[k] = behind.by_qq[here], behind.by_qv[here]
            then[k] = load[first[k] + min(i + 1, lengths[k] - 1)]
        for part in range(4):
            share = (part + 0.5) / 4
            for k in range(count):
                held, kk, dd = _gear(x[k], s[k], gear)
                held += (turn[k] + 0.5 * bend[k] * x[k]) * x[k]
                kk += turn[k] + bend[k] * x[k] + twist[k] * s[k]
                dd += drag[k] + twist[k] * x[k]
                tau = now[k] * (1.0 - share) + then[k] * share
                # The midpoint's spring and damper lose no energy of their own; those of the step's end are stable
                # where contacts are stiff for it.
                at = h if h * h * kk > 0.25 * m[k] else 0.5 * h
                acc = -(tau + held + kk * at * s[k] + dd * s[k]) / (m[k] + at * dd + at * at * kk)
                x[k] += h * (s[k] + at * acc)
                s[k] += h * acc
                mean[k] += acc / 4
                # A gear softer than gravity pulls lets its link fall: no gear, but no number without end either.
                if abs(x[k]) > _FURTHEST:
                    x[k], s[k] = math.copysign(_FURTHEST, x[k]), 0.0
        for k in range(count):
            if i < lengths[k]:
                out[2, first[k] + i] = mean[k]
    return out


@LazyKernel
def _gear(x, s, gear):  # pragma: no cover - compiled
    """Torque of a gear's spring at a deflection, its stiffness there, and its damping."""
    stiffness, damping, gap = gear.stiffness, gear.damping, gear.gap
    if gear.soft > 0.0:
        held, share = _flanks(x, gap, gear.soft)
        return stiffness * held, stiffness * share, damping * share
    beyond = x - gap if x > gap else min(x + gap, 0.0)
    if beyond == 0.0:
        return 0.0, 0.0, 0.0
    if gear.depth > 0.0:
        share = math.sqrt(abs(beyond) / gear.depth)
        held, kk, dd = stiffness * share * beyond, 1.5 * stiffness * share, damping * share
    else:
        grown = gear.cubic * beyond * beyond
        held, kk, dd = stiffness * (1.0 + grown) * beyond, stiffness * (1.0 + 3.0 * grown), damping
    if gap > 0.0 and (held + dd * s) * beyond < 0.0:
        return 0.0, 0.0, 0.0
    return held, kk, dd


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
