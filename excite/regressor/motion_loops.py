"""Compiled loops that carry motion from body to body along a trajectory.

They fill ``state``, of shape ``(n_joints + 1, STATE_SIZE * LANES)``, for a block of samples: for each body its rotation
(9 numbers, row by row), position, angular velocity, angular acceleration, acceleration of its origin less gravity, and
the axis of its joint, each number of all LANES samples in a row. All are written in one frame that the whole robot
shares, called the root frame: the base's for a floating robot (or the world's, on request), the world's for a fixed
one. Wrenches on bodies can then be summed without any further transformation.

Recursion: Luh, Walker, Paul (1980), outward pass.
"""

from __future__ import annotations

import math

import numpy as np

from excite.lazy_kernel import LazyKernel
from excite.regressor.tree import FREE_FLYER, PRISMATIC, REVOLUTE_UNBOUNDED

# Offsets into a body's state. numba notices a change only in the file that it compiles: after changing these or LANES,
# delete the __pycache__ folder.
POS, OMEGA, ALPHA, ACC, AXIS, STATE_SIZE = 9, 12, 15, 18, 21, 24
# Samples that go side by side: the processor works on several at a time, where one would wait for itself. Of 8, 16 and
# 32 on an AVX-512 machine, a G1's bodies take 1.58, 1.21 and 1.57 µs a sample to move; one after the other 1.83.
LANES = 16
# What is at hand of one joint, after the state of the body before it. That one is a copy: bodies lie in one array at
# distances that the compiler does not know, and it works on several lanes only where it sees that they are apart.
_COS, _SIN, _WAY, _TURN, _SLIDE, _SPIN, _THRUST, _COLUMNS, ROOM_SIZE = 24, 25, 26, 27, 28, 29, 30, 31, 35


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
def turn_joint(rotations, axes, aligned, room, state, j):
    """Rotation and axis of body ``j`` from the rotation of the body before it; arguments as of :func:`step_joint`."""
    # Nearly all axes are those of a frame: columns are counted from that one on.
    x = max(aligned, 0)
    y, z = (x + 1) % 3, (x + 2) % 3
    x0, x1, x2 = rotations[j, 0, x], rotations[j, 1, x], rotations[j, 2, x]
    y0, y1, y2 = rotations[j, 0, y], rotations[j, 1, y], rotations[j, 2, y]
    z0, z1, z2 = rotations[j, 0, z], rotations[j, 1, z], rotations[j, 2, z]
    e0, e1, e2 = axes[j, 0], axes[j, 1], axes[j, 2]
    for i in range(3):
        row = 3 * i * LANES
        for b in range(LANES):
            u0, u1, u2 = room[row + b], room[row + LANES + b], room[row + 2 * LANES + b]
            c, s = room[_COS * LANES + b], room[_SIN * LANES + b]
            a0, a1, a2 = u0 * x0 + u1 * x1 + u2 * x2, u0 * y0 + u1 * y1 + u2 * y2, u0 * z0 + u1 * z1 + u2 * z2
            # Row of A·R(axis, angle).
            along, b0, b1, b2 = a0, a0, c * a1 + s * a2, c * a2 - s * a1
            if aligned < 0:  # Rodrigues' formula
                along = a0 * e0 + a1 * e1 + a2 * e2
                k = (1.0 - c) * along
                b0 = c * a0 + s * (a1 * e2 - a2 * e1) + k * e0
                b1 = c * a1 + s * (a2 * e0 - a0 * e2) + k * e1
                b2 = c * a2 + s * (a0 * e1 - a1 * e0) + k * e2
            room[_COLUMNS * LANES + b], room[(_COLUMNS + 1) * LANES + b] = b0, b1
            room[(_COLUMNS + 2) * LANES + b], room[(_COLUMNS + 3) * LANES + b] = b2, along
        for b in range(LANES):
            state[j, row + x * LANES + b] = room[_COLUMNS * LANES + b]
        for b in range(LANES):
            state[j, row + y * LANES + b] = room[(_COLUMNS + 1) * LANES + b]
        for b in range(LANES):
            state[j, row + z * LANES + b] = room[(_COLUMNS + 2) * LANES + b]
        for b in range(LANES):
            state[j, (AXIS + i) * LANES + b] = room[(_COLUMNS + 3) * LANES + b]


@LazyKernel
def step_joint(rotations, translations, axes, aligned, room, state, j):
    """State of body ``j`` from that of the body before it and from its joint's motion, both in ``room``.

    Arrays come whole, with indices: a view would cost more, counted in and out, than the work on it.
    """
    turn_joint(rotations, axes, aligned, room, state, j)
    t0, t1, t2 = translations[j, 0], translations[j, 1], translations[j, 2]
    for b in range(LANES):
        z0, z1, z2 = (
            state[j, AXIS * LANES + b],
            state[j, (AXIS + 1) * LANES + b],
            state[j, (AXIS + 2) * LANES + b],
        )
        w0, w1, w2 = room[OMEGA * LANES + b], room[(OMEGA + 1) * LANES + b], room[(OMEGA + 2) * LANES + b]
        l0, l1, l2 = room[ALPHA * LANES + b], room[(ALPHA + 1) * LANES + b], room[(ALPHA + 2) * LANES + b]
        way, turn, spin = room[_WAY * LANES + b], room[_TURN * LANES + b], room[_SPIN * LANES + b]
        slide, thrust = 2.0 * room[_SLIDE * LANES + b], room[_THRUST * LANES + b]
        r0 = room[b] * t0 + room[LANES + b] * t1 + room[2 * LANES + b] * t2 + way * z0
        r1 = room[3 * LANES + b] * t0 + room[4 * LANES + b] * t1 + room[5 * LANES + b] * t2 + way * z1
        r2 = room[6 * LANES + b] * t0 + room[7 * LANES + b] * t1 + room[8 * LANES + b] * t2 + way * z2
        x0, x1, x2 = w1 * z2 - w2 * z1, w2 * z0 - w0 * z2, w0 * z1 - w1 * z0
        g0 = room[ACC * LANES + b] + slide * x0 + thrust * z0
        g1 = room[(ACC + 1) * LANES + b] + slide * x1 + thrust * z1
        g2 = room[(ACC + 2) * LANES + b] + slide * x2 + thrust * z2
        d, ww = w0 * r0 + w1 * r1 + w2 * r2, w0 * w0 + w1 * w1 + w2 * w2
        state[j, POS * LANES + b] = room[POS * LANES + b] + r0
        state[j, (POS + 1) * LANES + b] = room[(POS + 1) * LANES + b] + r1
        state[j, (POS + 2) * LANES + b] = room[(POS + 2) * LANES + b] + r2
        state[j, OMEGA * LANES + b] = w0 + turn * z0
        state[j, (OMEGA + 1) * LANES + b] = w1 + turn * z1
        state[j, (OMEGA + 2) * LANES + b] = w2 + turn * z2
        state[j, ALPHA * LANES + b] = l0 + spin * z0 + turn * x0
        state[j, (ALPHA + 1) * LANES + b] = l1 + spin * z1 + turn * x1
        state[j, (ALPHA + 2) * LANES + b] = l2 + spin * z2 + turn * x2
        state[j, ACC * LANES + b] = g0 + l1 * r2 - l2 * r1 + w0 * d - ww * r0
        state[j, (ACC + 1) * LANES + b] = g1 + l2 * r0 - l0 * r2 + w1 * d - ww * r1
        state[j, (ACC + 2) * LANES + b] = g2 + l0 * r1 - l1 * r0 + w2 * d - ww * r2


@LazyKernel
def joint_motion(kind, iq, iv, q, v, a, sample, room, b):
    """Motion of a joint at a sample into lane ``b`` of ``room``: it turns or slides."""
    turns = kind != PRISMATIC
    angle, rate, second = q[sample, iq], v[sample, iv], a[sample, iv]
    if kind == REVOLUTE_UNBOUNDED:
        c, s = angle, q[sample, iq + 1]
    elif turns:
        c, s = math.cos(angle), math.sin(angle)
    else:
        c, s = 1.0, 0.0
    room[_COS * LANES + b], room[_SIN * LANES + b], room[_WAY * LANES + b] = c, s, 0.0 if turns else angle
    room[_TURN * LANES + b], room[_SPIN * LANES + b] = (rate, second) if turns else (0.0, 0.0)
    room[_SLIDE * LANES + b], room[_THRUST * LANES + b] = (0.0, 0.0) if turns else (rate, second)


@LazyKernel
def move_bodies(
    kinds,
    parents,
    idx_q,
    idx_v,
    rotations,
    translations,
    axes,
    aligned,
    gravity,
    in_world,
    q,
    v,
    a,
    first,
    room,
    state,
):
    """Fill ``state (n_joints + 1, STATE_SIZE * LANES)`` of the samples of ``q (n, nq)``, ``v (n, nv)``, ``a (n, nv)``
    from ``first`` on; ``room (ROOM_SIZE * LANES)`` is scratch.

    Lanes that no sample is left for take the last one again. The structure comes array by array: a tuple would be taken
    apart, its references counted, at each block.
    """
    last = q.shape[0] - 1
    for i in range(STATE_SIZE * LANES):
        state[0, i] = 0.0
    for i in range(3):
        for b in range(LANES):
            state[0, 4 * i * LANES + b] = 1.0
            state[0, (ACC + i) * LANES + b] = -gravity[i]
    for j in range(1, kinds.shape[0]):
        if kinds[j] == FREE_FLYER:
            for b in range(LANES):
                t = min(first + b, last)
                start_root(rotations[j], translations[j], q[t], v[t], a[t], gravity, in_world, room)
                for i in range(STATE_SIZE):
                    state[j, i * LANES + b] = room[i]
            continue
        for i in range(STATE_SIZE * LANES):
            room[i] = state[parents[j], i]
        for b in range(LANES):
            joint_motion(kinds[j], idx_q[j], idx_v[j], q, v, a, min(first + b, last), room, b)
        step_joint(rotations, translations, axes, aligned[j], room, state, j)


@LazyKernel
def by_sample(block, state):
    """A block of states sample by sample, into ``state (LANES, n_joints + 1, STATE_SIZE)``.

    What goes on from one sample to the next would else read a line of the cache for each number.
    """
    for j in range(block.shape[0]):
        for b in range(LANES):
            for i in range(STATE_SIZE):
                state[b, j, i] = block[j, i * LANES + b]


@LazyKernel
def propagate_motion(structure, gravity, in_world, q, v, a, out):
    """Fill ``out (n, n_joints + 1, STATE_SIZE)`` from ``q (n, nq)``, ``v (n, nv)``, ``a (n, nv)``."""
    kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned = structure
    block, room = np.empty((kinds.shape[0], STATE_SIZE * LANES)), np.empty(ROOM_SIZE * LANES)
    state = np.empty((LANES, kinds.shape[0], STATE_SIZE))
    for first in range(0, q.shape[0], LANES):
        move_bodies(
            kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned, gravity, in_world,
            q, v, a, first, room, block,
        )  # fmt: skip
        by_sample(block, state)
        for b in range(min(LANES, q.shape[0] - first)):
            for j in range(state.shape[1]):
                for i in range(STATE_SIZE):
                    out[first + b, j, i] = state[b, j, i]
