"""Compiled loops that carry motion from body to body along a trajectory.

They fill ``state``, of shape ``(n_joints + 1, 24)`` for each sample: for each body its rotation (9 numbers, row
by row), position, angular velocity, angular acceleration, acceleration of its origin less gravity, and the
axis of its joint. All are written in one frame that the whole robot shares, called the root frame: the base's
for a floating robot (or the world's, on request), the world's for a fixed one. Wrenches on bodies can then be
summed without any further transformation.

Recursion: Luh, Walker, Paul (1980), outward pass.
"""

from __future__ import annotations

import math

from excite.lazy_kernel import LazyKernel
from excite.regressor.tree import FREE_FLYER, PRISMATIC, REVOLUTE_UNBOUNDED

# Offsets into a body's state. numba notices a change only in the file that it compiles: after changing these,
# delete the __pycache__ folder.
POS, OMEGA, ALPHA, ACC, AXIS, STATE_SIZE = 9, 12, 15, 18, 21, 24


@LazyKernel
def start_root(rotation, translation, q, v, a, gravity, in_world, s):
    """State of the floating base: ``s`` is its row of 24 numbers."""
    x, y, z, w = q[3], q[4], q[5], q[6]
    scale = 2.0 / (x * x + y * y + z * z + w * w)
    e = (
        1.0 - scale * (y * y + z * z), scale * (x * y - z * w), scale * (x * z + y * w),
        scale * (x * y + z * w), 1.0 - scale * (x * x + z * z), scale * (y * z - x * w),
        scale * (x * z - y * w), scale * (y * z + x * w), 1.0 - scale * (x * x + y * y),
    )  # fmt: skip
    world = s[:9]
    for i in range(3):
        for k in range(3):
            world[3 * i + k] = rotation[i, 0] * e[k] + rotation[i, 1] * e[3 + k] + rotation[i, 2] * e[6 + k]
    w0, w1, w2 = v[3], v[4], v[5]
    linear = (
        a[0] + w1 * v[2] - w2 * v[1],
        a[1] + w2 * v[0] - w0 * v[2],
        a[2] + w0 * v[1] - w1 * v[0],
    )
    for i in range(3):
        if in_world:
            s[POS + i] = (
                translation[i] + rotation[i, 0] * q[0] + rotation[i, 1] * q[1] + rotation[i, 2] * q[2]
            )
            s[OMEGA + i] = world[3 * i] * w0 + world[3 * i + 1] * w1 + world[3 * i + 2] * w2
            s[ALPHA + i] = world[3 * i] * a[3] + world[3 * i + 1] * a[4] + world[3 * i + 2] * a[5]
            s[ACC + i] = (
                world[3 * i] * linear[0]
                + world[3 * i + 1] * linear[1]
                + world[3 * i + 2] * linear[2]
                - gravity[i]
            )
        else:
            s[POS + i] = 0.0
            s[OMEGA + i] = v[3 + i]
            s[ALPHA + i] = a[3 + i]
            s[ACC + i] = linear[i] - (
                world[i] * gravity[0] + world[3 + i] * gravity[1] + world[6 + i] * gravity[2]
            )
        s[AXIS + i] = 0.0
    if not in_world:
        for i in range(9):
            world[i] = 1.0 if i % 4 == 0 else 0.0


@LazyKernel
def turn_joint(kind, rotations, axes, aligned, qc, qs, state, up, j):
    """Rotation and axis of body ``j`` in the world from its parent's; arguments as of :func:`step_joint`."""
    c, sn = (1.0, 0.0) if kind == PRISMATIC else (qc, qs)
    for i in range(3):
        u0, u1, u2 = state[up, 3 * i], state[up, 3 * i + 1], state[up, 3 * i + 2]
        a0 = u0 * rotations[j, 0, 0] + u1 * rotations[j, 1, 0] + u2 * rotations[j, 2, 0]
        a1 = u0 * rotations[j, 0, 1] + u1 * rotations[j, 1, 1] + u2 * rotations[j, 2, 1]
        a2 = u0 * rotations[j, 0, 2] + u1 * rotations[j, 1, 2] + u2 * rotations[j, 2, 2]
        # Row of A·R(axis, angle); nearly all axes are those of a frame.
        if aligned == 0:
            state[j, AXIS + i] = a0
            state[j, 3 * i], state[j, 3 * i + 1], state[j, 3 * i + 2] = a0, c * a1 + sn * a2, c * a2 - sn * a1
        elif aligned == 1:
            state[j, AXIS + i] = a1
            state[j, 3 * i], state[j, 3 * i + 1], state[j, 3 * i + 2] = c * a0 - sn * a2, a1, c * a2 + sn * a0
        elif aligned == 2:
            state[j, AXIS + i] = a2
            state[j, 3 * i], state[j, 3 * i + 1], state[j, 3 * i + 2] = c * a0 + sn * a1, c * a1 - sn * a0, a2
        else:  # Rodrigues' formula
            z = a0 * axes[j, 0] + a1 * axes[j, 1] + a2 * axes[j, 2]
            k = (1.0 - c) * z
            state[j, AXIS + i] = z
            state[j, 3 * i] = c * a0 + sn * (a1 * axes[j, 2] - a2 * axes[j, 1]) + k * axes[j, 0]
            state[j, 3 * i + 1] = c * a1 + sn * (a2 * axes[j, 0] - a0 * axes[j, 2]) + k * axes[j, 1]
            state[j, 3 * i + 2] = c * a2 + sn * (a0 * axes[j, 1] - a1 * axes[j, 0]) + k * axes[j, 2]


@LazyKernel
def step_joint(kind, rotations, translations, axes, aligned, qc, qs, qd, qdd, state, up, j):
    """State of body ``j`` from that of its parent ``up``; ``qc, qs`` are cosine and sine of a revolute angle.

    Arrays come whole, with indices: a view would cost more, counted in and out, than the work on it.
    """
    turn_joint(kind, rotations, axes, aligned, qc, qs, state, up, j)
    r0 = (
        state[up, 0] * translations[j, 0]
        + state[up, 1] * translations[j, 1]
        + state[up, 2] * translations[j, 2]
    )
    r1 = (
        state[up, 3] * translations[j, 0]
        + state[up, 4] * translations[j, 1]
        + state[up, 5] * translations[j, 2]
    )
    r2 = (
        state[up, 6] * translations[j, 0]
        + state[up, 7] * translations[j, 1]
        + state[up, 8] * translations[j, 2]
    )
    z0, z1, z2 = state[j, AXIS], state[j, AXIS + 1], state[j, AXIS + 2]
    w0, w1, w2 = state[up, OMEGA], state[up, OMEGA + 1], state[up, OMEGA + 2]
    l0, l1, l2 = state[up, ALPHA], state[up, ALPHA + 1], state[up, ALPHA + 2]
    x0, x1, x2 = qd * (w1 * z2 - w2 * z1), qd * (w2 * z0 - w0 * z2), qd * (w0 * z1 - w1 * z0)
    g0, g1, g2 = state[up, ACC], state[up, ACC + 1], state[up, ACC + 2]
    if kind == PRISMATIC:
        r0, r1, r2 = r0 + qs * z0, r1 + qs * z1, r2 + qs * z2
        g0, g1, g2 = g0 + 2.0 * x0 + qdd * z0, g1 + 2.0 * x1 + qdd * z1, g2 + 2.0 * x2 + qdd * z2
        state[j, OMEGA], state[j, OMEGA + 1], state[j, OMEGA + 2] = w0, w1, w2
        state[j, ALPHA], state[j, ALPHA + 1], state[j, ALPHA + 2] = l0, l1, l2
    else:
        state[j, OMEGA], state[j, OMEGA + 1], state[j, OMEGA + 2] = w0 + qd * z0, w1 + qd * z1, w2 + qd * z2
        state[j, ALPHA], state[j, ALPHA + 1], state[j, ALPHA + 2] = (
            l0 + qdd * z0 + x0,
            l1 + qdd * z1 + x1,
            l2 + qdd * z2 + x2,
        )
    d = w0 * r0 + w1 * r1 + w2 * r2
    ww = w0 * w0 + w1 * w1 + w2 * w2
    state[j, POS], state[j, POS + 1], state[j, POS + 2] = (
        state[up, POS] + r0,
        state[up, POS + 1] + r1,
        state[up, POS + 2] + r2,
    )
    state[j, ACC] = g0 + l1 * r2 - l2 * r1 + w0 * d - ww * r0
    state[j, ACC + 1] = g1 + l2 * r0 - l0 * r2 + w1 * d - ww * r1
    state[j, ACC + 2] = g2 + l0 * r1 - l1 * r0 + w2 * d - ww * r2


@LazyKernel
def move(
    kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned, gravity, in_world, q, v, a, state
):
    """Fill ``state (n_joints + 1, 24)`` of one sample from ``q (nq)``, ``v (nv)``, ``a (nv)``.

    The structure comes array by array: a tuple would be taken apart, its references counted, at each sample.
    """
    for i in range(STATE_SIZE):
        state[0, i] = 0.0
    for i in range(3):
        state[0, 4 * i] = 1.0
        state[0, ACC + i] = -gravity[i]
    for j in range(1, kinds.shape[0]):
        iq, iv = idx_q[j], idx_v[j]
        if kinds[j] == FREE_FLYER:
            start_root(rotations[j], translations[j], q, v, a, gravity, in_world, state[j])
            continue
        if kinds[j] == REVOLUTE_UNBOUNDED:
            qc, qs = q[iq], q[iq + 1]
        elif kinds[j] == PRISMATIC:
            qc, qs = 1.0, q[iq]
        else:
            qc, qs = math.cos(q[iq]), math.sin(q[iq])
        step_joint(
            kinds[j], rotations, translations, axes, aligned[j], qc, qs, v[iv], a[iv],
            state, parents[j], j,
        )  # fmt: skip


@LazyKernel
def propagate(structure, gravity, in_world, q, v, a, state):
    """Fill ``state (n, n_joints + 1, 24)`` from ``q (n, nq)``, ``v (n, nv)``, ``a (n, nv)``."""
    kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned = structure
    for t in range(q.shape[0]):
        move(
            kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned, gravity, in_world,
            q[t], v[t], a[t], state[t],
        )  # fmt: skip
