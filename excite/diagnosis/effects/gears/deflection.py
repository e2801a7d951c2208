"""The motion of a link behind a soft or loose gear."""

from __future__ import annotations

import math

import numpy as np

from excite.lazy_kernel import LazyKernel

# No gear gives way further [rad].
_FURTHEST = 1.0
# Trials that go side by side: the processor works on several at a time, where one would wait for itself. Of 4, 8 and
# 16 lanes on an AVX-512 machine, 8 take .48 of the time of one after the other for 8 trials, .74 for 4 and 1.5 for 1.
LANES = 8
# What is known of each lane, one after the other in one array: the compiler then sees that they are apart.
_X, _S, _MEAN, _NOW, _THEN, _INERTIA, _TURN, _DRAG, _BEND, _TWIST = range(10)


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
    out = np.empty((3, len(load)))
    first, lengths = _trials(starts)
    flat = gear.soft == 0.0 and gear.depth == 0.0
    room = np.empty(10 * LANES)
    for group in range(0, len(first), LANES):
        # Lanes that no trial is left for go through the last one again.
        width, longest = min(LANES, len(first) - group), 0
        for k in range(LANES):
            trial = group + min(k, width - 1)
            start, longest = first[trial], max(longest, lengths[trial])
            # A load that falls as the link gives way softens the gear; it is not let carry all of it.
            held = max(1.0 + behind.by_q[start] / stiffness, 0.2)
            rest = _settled(-load[start] / (stiffness * held), gap, cubic / held)
            room[_X * LANES + k], room[_S * LANES + k] = rest + begin[trial, 0], begin[trial, 1]
        for i in range(longest):
            for k in range(LANES):
                trial = group + min(k, width - 1)
                # A trial that has ended goes on under its last load, unrecorded.
                last = lengths[trial] - 1
                here = first[trial] + min(i, last)
                if i <= last:
                    out[0, here], out[1, here] = room[_X * LANES + k], room[_S * LANES + k]
                room[_NOW * LANES + k], room[_THEN * LANES + k] = (
                    load[here],
                    load[first[trial] + min(i + 1, last)],
                )
                room[_INERTIA * LANES + k], room[_MEAN * LANES + k] = behind.inertia[here], 0.0
                room[_TURN * LANES + k], room[_DRAG * LANES + k] = behind.by_q[here], behind.by_v[here]
                room[_BEND * LANES + k], room[_TWIST * LANES + k] = behind.by_qq[here], behind.by_qv[here]
            for part in range(4):
                if flat:
                    _flat_step(room, stiffness, gear.damping, gap, cubic, (part + 0.5) / 4, dt / 4)
                else:
                    _round_step(room, gear, (part + 0.5) / 4, dt / 4)
            for k in range(width):
                if i < lengths[group + k]:
                    out[2, first[group + k] + i] = room[_MEAN * LANES + k]
    return out


@LazyKernel
def added_torque(by_q, by_v, mass, moved):  # pragma: no cover - compiled
    """Torques ``(n_joints, n)`` of a deflection, its speed and its acceleration, the rows of ``moved (3, n)``.

    The others are changes of all torques with the joint's motion, ``(n, n_joints)``.
    """
    out = np.empty((by_q.shape[1], by_q.shape[0]))
    for k in range(by_q.shape[1]):
        for i in range(by_q.shape[0]):
            out[k, i] = by_q[i, k] * moved[0, i] + by_v[i, k] * moved[1, i] + mass[i, k] * moved[2, i]
    return out


@LazyKernel
def _flat_step(room, stiffness, damping, gap, cubic, share, h):  # pragma: no cover - compiled
    """A quarter of a sample of all lanes, flanks flat: no branches, so that lanes go together."""
    for k in range(LANES):
        x, s = room[_X * LANES + k], room[_S * LANES + k]
        beyond = (x - gap if x > gap else 0.0) + (x + gap if x + gap < 0.0 else 0.0)
        grown = cubic * beyond * beyond
        held, kk = stiffness * (1.0 + grown) * beyond, stiffness * (1.0 + 3.0 * grown)
        apart = (beyond == 0.0) | ((gap > 0.0) & ((held + damping * s) * beyond < 0.0))
        held, kk, dd = 0.0 if apart else held, 0.0 if apart else kk, 0.0 if apart else damping
        _midpoint(room, k, held, kk, dd, share, h)


@LazyKernel
def _round_step(room, gear, share, h):  # pragma: no cover - compiled
    """A quarter of a sample of all lanes, flanks soft or round."""
    for k in range(LANES):
        held, kk, dd = _gear(room[_X * LANES + k], room[_S * LANES + k], gear)
        _midpoint(room, k, held, kk, dd, share, h)


@LazyKernel
def _midpoint(room, k, held, kk, dd, share, h):  # pragma: no cover - compiled
    """A step of a lane whose gear holds ``held`` with a stiffness ``kk`` and a damping ``dd``."""
    x, s, m = room[_X * LANES + k], room[_S * LANES + k], room[_INERTIA * LANES + k]
    turn, drag = room[_TURN * LANES + k], room[_DRAG * LANES + k]
    bend, twist = room[_BEND * LANES + k], room[_TWIST * LANES + k]
    held += (turn + 0.5 * bend * x) * x
    kk += turn + bend * x + twist * s
    dd += drag + twist * x
    tau = room[_NOW * LANES + k] * (1.0 - share) + room[_THEN * LANES + k] * share
    # The midpoint's spring and damper lose no energy of their own; those of the step's end are stable where contacts
    # are stiff for it.
    at = h if h * h * kk > 0.25 * m else 0.5 * h
    acc = -(tau + held + kk * at * s + dd * s) / (m + at * dd + at * at * kk)
    x, s = x + h * (s + at * acc), s + h * acc
    # A gear softer than gravity pulls lets its link fall: no gear, but no number without end either.
    beyond = abs(x) > _FURTHEST
    room[_X * LANES + k], room[_S * LANES + k] = (
        math.copysign(_FURTHEST, x) if beyond else x,
        0.0 if beyond else s,
    )
    room[_MEAN * LANES + k] += acc / 4


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
