"""Compiled loops from the motion of the bodies to regressors.

``block`` and ``state`` are what :func:`~excite.regressor.motion_loops.move_bodies` and
:func:`~excite.regressor.motion_loops.by_sample` fill, of a few samples at a time: they stay in the cache.
Source: the regressor of one body, Atkeson, An, Hollerbach (1986), eq. 9-11.
"""

from __future__ import annotations

from excite.lazy_kernel import LazyKernel
from excite.regressor.motion_loops import ACC, ALPHA, AXIS, LANES, OMEGA, POS, by_sample, move_bodies
from excite.regressor.tree import FREE_FLYER, PRISMATIC


@LazyKernel
def body_rows(state, j, b, out, t, first):
    """Regressor of body ``j``'s wrench at the root's origin in lane ``b``, into ``out[t, :, first:first + 10]``.

    Arrays come whole, with indices: a view would cost more, counted in and out, than half the work on it.
    """
    p0, p1, p2 = state[b, j, POS], state[b, j, POS + 1], state[b, j, POS + 2]
    w0, w1, w2 = state[b, j, OMEGA], state[b, j, OMEGA + 1], state[b, j, OMEGA + 2]
    l0, l1, l2 = state[b, j, ALPHA], state[b, j, ALPHA + 1], state[b, j, ALPHA + 2]
    a0, a1, a2 = state[b, j, ACC], state[b, j, ACC + 1], state[b, j, ACC + 2]
    out[t, 0, first], out[t, 1, first], out[t, 2, first] = a0, a1, a2
    out[t, 3, first] = p1 * a2 - p2 * a1
    out[t, 4, first] = p2 * a0 - p0 * a2
    out[t, 5, first] = p0 * a1 - p1 * a0
    # Acceleration per unit of place in the body: alpha × x + w × (w × x).
    e01, e02, e12 = w0 * w1, w0 * w2, w1 * w2
    e00, e11, e22 = -(w1 * w1 + w2 * w2), -(w0 * w0 + w2 * w2), -(w0 * w0 + w1 * w1)
    for k in range(3):
        x0, x1, x2 = state[b, j, k], state[b, j, 3 + k], state[b, j, 6 + k]
        f0 = e00 * x0 + (e01 - l2) * x1 + (e02 + l1) * x2
        f1 = (e01 + l2) * x0 + e11 * x1 + (e12 - l0) * x2
        f2 = (e02 - l1) * x0 + (e12 + l0) * x1 + e22 * x2
        column = first + 1 + k
        out[t, 0, column], out[t, 1, column], out[t, 2, column] = f0, f1, f2
        out[t, 3, column] = x1 * a2 - x2 * a1 + p1 * f2 - p2 * f1
        out[t, 4, column] = x2 * a0 - x0 * a2 + p2 * f0 - p0 * f2
        out[t, 5, column] = x0 * a1 - x1 * a0 + p0 * f1 - p1 * f0
    for i in range(3):
        for column in range(first + 4, first + 10):
            out[t, i, column] = 0.0
    # Inertia: I·alpha + w × I·w in the body's frame, turned into the root's.
    r00, r01, r02 = state[b, j, 0], state[b, j, 1], state[b, j, 2]
    r10, r11, r12 = state[b, j, 3], state[b, j, 4], state[b, j, 5]
    r20, r21, r22 = state[b, j, 6], state[b, j, 7], state[b, j, 8]
    lx, ly, lz = (
        r00 * l0 + r10 * l1 + r20 * l2,
        r01 * l0 + r11 * l1 + r21 * l2,
        r02 * l0 + r12 * l1 + r22 * l2,
    )
    wx, wy, wz = (
        r00 * w0 + r10 * w1 + r20 * w2,
        r01 * w0 + r11 * w1 + r21 * w2,
        r02 * w0 + r12 * w1 + r22 * w2,
    )
    xx, yy, zz, xy, xz, yz = wx * wx, wy * wy, wz * wz, wx * wy, wx * wz, wy * wz
    for i in range(3):
        x, y, z = state[b, j, 3 * i], state[b, j, 3 * i + 1], state[b, j, 3 * i + 2]
        row, u, v, w = 3 + i, x * yz, y * xz, z * xy
        out[t, row, first + 4] = x * lx + (v - w)
        out[t, row, first + 5] = x * (ly - xz) + y * (lx + yz) + z * (xx - yy)
        out[t, row, first + 6] = y * ly + (w - u)
        out[t, row, first + 7] = x * (lz + xy) + y * (zz - xx) + z * (lx - yz)
        out[t, row, first + 8] = x * (yy - zz) + y * (lz - xy) + z * (ly + xz)
        out[t, row, first + 9] = z * lz + (u - v)


@LazyKernel
def base_rows(structure, gravity, q, v, a, room, block, state, out):
    """Wrench regressor of all bodies at the root's origin; ``out (n, 6, 10·n_segments)``."""
    kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned = structure
    for first in range(0, q.shape[0], LANES):
        move_bodies(
            kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned, gravity, False,
            q, v, a, first, room, block,
        )  # fmt: skip
        by_sample(block, state)
        for b in range(min(LANES, q.shape[0] - first)):
            for j in range(1, state.shape[1]):
                body_rows(state, j, b, out, first + b, 10 * (j - 1))


@LazyKernel
def write_screw(kind, state, j, b, screws):
    """What joint ``j`` carries in lane ``b`` of a wrench (force, moment) at the root's origin, into ``screws[j]``.

    Along a prismatic axis it is the force, else the moment about the axis.
    """
    z0, z1, z2 = state[b, j, AXIS], state[b, j, AXIS + 1], state[b, j, AXIS + 2]
    if kind == PRISMATIC:
        screws[j, 0], screws[j, 1], screws[j, 2] = z0, z1, z2
        screws[j, 3], screws[j, 4], screws[j, 5] = 0.0, 0.0, 0.0
    else:
        p0, p1, p2 = state[b, j, POS], state[b, j, POS + 1], state[b, j, POS + 2]
        screws[j, 0], screws[j, 1], screws[j, 2] = p1 * z2 - p2 * z1, p2 * z0 - p0 * z2, p0 * z1 - p1 * z0
        screws[j, 3], screws[j, 4], screws[j, 5] = z0, z1, z2


@LazyKernel
def torque_rows(structure, gravity, q, v, a, room, block, state, wrench, screws, out):
    """Joint torque regressor, into ``out (n, nv, 10·n_segments)``.

    ``wrench (1, 6, 10)`` and ``screws (n_joints + 1, 6)`` are scratch.
    """
    kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned = structure
    for first in range(0, q.shape[0], LANES):
        move_bodies(
            kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned, gravity, False,
            q, v, a, first, room, block,
        )  # fmt: skip
        by_sample(block, state)
        for b in range(min(LANES, q.shape[0] - first)):
            sample_rows(kinds, parents, idx_v, state, b, wrench, screws, out, first + b)


@LazyKernel
def write_wrench(wrench, out, t, i, first):
    """What a free base carries of a body's wrench regressor: all of it."""
    for row in range(6):
        for k in range(10):
            out[t, i + row, first + k] = wrench[0, row, k]


@LazyKernel
def sample_rows(kinds, parents, idx_v, state, b, wrench, screws, out, t):
    """Joint torque regressor of lane ``b``, into ``out[t]``."""
    for i in range(out.shape[1]):
        for k in range(out.shape[2]):
            out[t, i, k] = 0.0
    for j in range(1, state.shape[1]):
        write_screw(kinds[j], state, j, b, screws)
    for body in range(1, state.shape[1]):
        first, j = 10 * (body - 1), body
        body_rows(state, body, b, wrench, 0, 0)
        while j > 0:
            i = idx_v[j]
            if kinds[j] == FREE_FLYER:
                write_wrench(wrench, out, t, i, first)
            else:
                # Handing the arrays over to a function of its own would take as long as the work on them.
                f0, f1, f2 = screws[j, 0], screws[j, 1], screws[j, 2]
                m0, m1, m2 = screws[j, 3], screws[j, 4], screws[j, 5]
                # Only mass and first moments make a force.
                for k in range(4):
                    force = f0 * wrench[0, 0, k] + f1 * wrench[0, 1, k] + f2 * wrench[0, 2, k]
                    moment = m0 * wrench[0, 3, k] + m1 * wrench[0, 4, k] + m2 * wrench[0, 5, k]
                    out[t, i, first + k] = force + moment
                for k in range(4, 10):
                    out[t, i, first + k] = m0 * wrench[0, 3, k] + m1 * wrench[0, 4, k] + m2 * wrench[0, 5, k]
            j = parents[j]
