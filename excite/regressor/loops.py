"""Compiled loops from the motion of the bodies to wrenches: regressors and inverse dynamics.

``state`` is what :mod:`excite.regressor.motion_loops` fills, of one sample at a time: it stays in the cache.
Sources: the regressor of one body, Atkeson, An, Hollerbach (1986), eq. 9-11; the inward pass, Luh, Walker,
Paul (1980).
"""

from __future__ import annotations

from excite.lazy_kernel import LazyKernel
from excite.regressor.motion_loops import ACC, ALPHA, AXIS, OMEGA, POS, move
from excite.regressor.tree import FREE_FLYER, PRISMATIC


@LazyKernel
def body_rows(state, j, out, first):
    """Regressor of body ``j``'s wrench at the root's origin, into ``out[:, first:first + 10]``."""
    p0, p1, p2 = state[j, POS], state[j, POS + 1], state[j, POS + 2]
    w0, w1, w2 = state[j, OMEGA], state[j, OMEGA + 1], state[j, OMEGA + 2]
    l0, l1, l2 = state[j, ALPHA], state[j, ALPHA + 1], state[j, ALPHA + 2]
    a0, a1, a2 = state[j, ACC], state[j, ACC + 1], state[j, ACC + 2]
    out[0, first], out[1, first], out[2, first] = a0, a1, a2
    out[3, first] = p1 * a2 - p2 * a1
    out[4, first] = p2 * a0 - p0 * a2
    out[5, first] = p0 * a1 - p1 * a0
    for k in range(3):
        x0, x1, x2 = state[j, k], state[j, 3 + k], state[j, 6 + k]
        c0, c1, c2 = w1 * x2 - w2 * x1, w2 * x0 - w0 * x2, w0 * x1 - w1 * x0
        f0 = l1 * x2 - l2 * x1 + w1 * c2 - w2 * c1
        f1 = l2 * x0 - l0 * x2 + w2 * c0 - w0 * c2
        f2 = l0 * x1 - l1 * x0 + w0 * c1 - w1 * c0
        column = first + 1 + k
        out[0, column], out[1, column], out[2, column] = f0, f1, f2
        out[3, column] = x1 * a2 - x2 * a1 + p1 * f2 - p2 * f1
        out[4, column] = x2 * a0 - x0 * a2 + p2 * f0 - p0 * f2
        out[5, column] = x0 * a1 - x1 * a0 + p0 * f1 - p1 * f0
    for i in range(3):
        for column in range(first + 4, first + 10):
            out[i, column] = 0.0
    # Inertia: I·alpha + w × I·w, with alpha and w also in the body's frame.
    lx, ly, lz = (
        state[j, 0] * l0 + state[j, 3] * l1 + state[j, 6] * l2,
        state[j, 1] * l0 + state[j, 4] * l1 + state[j, 7] * l2,
        state[j, 2] * l0 + state[j, 5] * l1 + state[j, 8] * l2,
    )
    wx, wy, wz = (
        state[j, 0] * w0 + state[j, 3] * w1 + state[j, 6] * w2,
        state[j, 1] * w0 + state[j, 4] * w1 + state[j, 7] * w2,
        state[j, 2] * w0 + state[j, 5] * w1 + state[j, 8] * w2,
    )
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        wj, wk = state[j, OMEGA + i1], state[j, OMEGA + i2]
        x, y, z = state[j, 3 * i], state[j, 3 * i + 1], state[j, 3 * i + 2]
        cx = wj * state[j, 3 * i2] - wk * state[j, 3 * i1]
        cy = wj * state[j, 3 * i2 + 1] - wk * state[j, 3 * i1 + 1]
        cz = wj * state[j, 3 * i2 + 2] - wk * state[j, 3 * i1 + 2]
        out[3 + i, first + 4] = x * lx + cx * wx
        out[3 + i, first + 5] = x * ly + y * lx + cx * wy + cy * wx
        out[3 + i, first + 6] = y * ly + cy * wy
        out[3 + i, first + 7] = x * lz + z * lx + cx * wz + cz * wx
        out[3 + i, first + 8] = y * lz + z * ly + cy * wz + cz * wy
        out[3 + i, first + 9] = z * lz + cz * wz


@LazyKernel
def base_rows(structure, gravity, q, v, a, state, out):
    """Wrench regressor of all bodies at the root's origin; ``out (n, 6, 10·n_segments)``."""
    kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned = structure
    for t in range(q.shape[0]):
        move(
            kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned, gravity, False,
            q[t], v[t], a[t], state,
        )  # fmt: skip
        rows = out[t]
        for j in range(1, state.shape[0]):
            body_rows(state, j, rows, 10 * (j - 1))


@LazyKernel
def write_screw(kind, state, j, screws):
    """What joint ``j`` carries of a wrench (force, moment) at the root's origin: a pure force along a prismatic axis,
    else the moment about the axis, into ``screws[j]``.
    """
    z0, z1, z2 = state[j, AXIS], state[j, AXIS + 1], state[j, AXIS + 2]
    if kind == PRISMATIC:
        screws[j, 0], screws[j, 1], screws[j, 2] = z0, z1, z2
        screws[j, 3], screws[j, 4], screws[j, 5] = 0.0, 0.0, 0.0
    else:
        p0, p1, p2 = state[j, POS], state[j, POS + 1], state[j, POS + 2]
        screws[j, 0], screws[j, 1], screws[j, 2] = p1 * z2 - p2 * z1, p2 * z0 - p0 * z2, p0 * z1 - p1 * z0
        screws[j, 3], screws[j, 4], screws[j, 5] = z0, z1, z2


@LazyKernel
def project(screws, j, fx, fy, fz, mx, my, mz, row):
    """What joint ``j`` carries of a body's wrench regressor, given row by row, into ``row (10,)``."""
    a, b, c = screws[j, 0], screws[j, 1], screws[j, 2]
    d, e, f = screws[j, 3], screws[j, 4], screws[j, 5]
    # All is read before anything is written: the compiler then needs no proof that the arrays are apart, and
    # works on several columns at a time. Only mass and first moments make a force.
    x0 = a * fx[0] + b * fy[0] + c * fz[0] + d * mx[0] + e * my[0] + f * mz[0]
    x1 = a * fx[1] + b * fy[1] + c * fz[1] + d * mx[1] + e * my[1] + f * mz[1]
    x2 = a * fx[2] + b * fy[2] + c * fz[2] + d * mx[2] + e * my[2] + f * mz[2]
    x3 = a * fx[3] + b * fy[3] + c * fz[3] + d * mx[3] + e * my[3] + f * mz[3]
    x4 = d * mx[4] + e * my[4] + f * mz[4]
    x5 = d * mx[5] + e * my[5] + f * mz[5]
    x6 = d * mx[6] + e * my[6] + f * mz[6]
    x7 = d * mx[7] + e * my[7] + f * mz[7]
    x8 = d * mx[8] + e * my[8] + f * mz[8]
    x9 = d * mx[9] + e * my[9] + f * mz[9]
    row[0], row[1], row[2], row[3], row[4] = x0, x1, x2, x3, x4
    row[5], row[6], row[7], row[8], row[9] = x5, x6, x7, x8, x9


@LazyKernel
def torque_rows(structure, gravity, q, v, a, state, wrench, screws, out):
    """Joint torque regressor, into ``out (n, nv, 10·n_segments)``.

    ``wrench (6, 10)`` and ``screws (n_joints + 1, 6)`` are scratch.
    """
    fx, fy, fz, mx, my, mz = wrench[0], wrench[1], wrench[2], wrench[3], wrench[4], wrench[5]
    kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned = structure
    for t in range(q.shape[0]):
        move(
            kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned, gravity, False,
            q[t], v[t], a[t], state,
        )  # fmt: skip
        rows = out[t]
        for i in range(rows.shape[0]):
            for k in range(rows.shape[1]):
                rows[i, k] = 0.0
        for j in range(1, state.shape[0]):
            write_screw(kinds[j], state, j, screws)
        for body in range(1, state.shape[0]):
            first = 10 * (body - 1)
            body_rows(state, body, wrench, 0)
            j = body
            while j > 0:
                if kinds[j] == FREE_FLYER:
                    for i in range(6):
                        for k in range(10):
                            rows[idx_v[j] + i, first + k] = wrench[i, k]
                else:
                    project(screws, j, fx, fy, fz, mx, my, mz, rows[idx_v[j], first : first + 10])
                j = parents[j]


@LazyKernel
def body_wrench(state, j, phi, first, forces):
    """Wrench on body ``j`` at the root's origin for ``phi[first:first + 10]``, added to ``forces[j]``."""
    m = phi[first]
    h0 = state[j, 0] * phi[first + 1] + state[j, 1] * phi[first + 2] + state[j, 2] * phi[first + 3]
    h1 = state[j, 3] * phi[first + 1] + state[j, 4] * phi[first + 2] + state[j, 5] * phi[first + 3]
    h2 = state[j, 6] * phi[first + 1] + state[j, 7] * phi[first + 2] + state[j, 8] * phi[first + 3]
    w0, w1, w2 = state[j, OMEGA], state[j, OMEGA + 1], state[j, OMEGA + 2]
    l0, l1, l2 = state[j, ALPHA], state[j, ALPHA + 1], state[j, ALPHA + 2]
    a0, a1, a2 = state[j, ACC], state[j, ACC + 1], state[j, ACC + 2]
    d, ww = w0 * h0 + w1 * h1 + w2 * h2, w0 * w0 + w1 * w1 + w2 * w2
    f0 = m * a0 + l1 * h2 - l2 * h1 + w0 * d - ww * h0
    f1 = m * a1 + l2 * h0 - l0 * h2 + w1 * d - ww * h1
    f2 = m * a2 + l0 * h1 - l1 * h0 + w2 * d - ww * h2
    xx, xy, yy = phi[first + 4], phi[first + 5], phi[first + 6]
    xz, yz, zz = phi[first + 7], phi[first + 8], phi[first + 9]
    lx, ly, lz = (
        state[j, 0] * l0 + state[j, 3] * l1 + state[j, 6] * l2,
        state[j, 1] * l0 + state[j, 4] * l1 + state[j, 7] * l2,
        state[j, 2] * l0 + state[j, 5] * l1 + state[j, 8] * l2,
    )
    wx, wy, wz = (
        state[j, 0] * w0 + state[j, 3] * w1 + state[j, 6] * w2,
        state[j, 1] * w0 + state[j, 4] * w1 + state[j, 7] * w2,
        state[j, 2] * w0 + state[j, 5] * w1 + state[j, 8] * w2,
    )
    ix, iy, iz = xx * wx + xy * wy + xz * wz, xy * wx + yy * wy + yz * wz, xz * wx + yz * wy + zz * wz
    nx = xx * lx + xy * ly + xz * lz + wy * iz - wz * iy
    ny = xy * lx + yy * ly + yz * lz + wz * ix - wx * iz
    nz = xz * lx + yz * ly + zz * lz + wx * iy - wy * ix
    p0, p1, p2 = state[j, POS], state[j, POS + 1], state[j, POS + 2]
    forces[j, 0] += f0
    forces[j, 1] += f1
    forces[j, 2] += f2
    forces[j, 3] += (
        state[j, 0] * nx + state[j, 1] * ny + state[j, 2] * nz + h1 * a2 - h2 * a1 + p1 * f2 - p2 * f1
    )
    forces[j, 4] += (
        state[j, 3] * nx + state[j, 4] * ny + state[j, 5] * nz + h2 * a0 - h0 * a2 + p2 * f0 - p0 * f2
    )
    forces[j, 5] += (
        state[j, 6] * nx + state[j, 7] * ny + state[j, 8] * nz + h0 * a1 - h1 * a0 + p0 * f1 - p1 * f0
    )


@LazyKernel
def inward(kinds, parents, idx_v, phi, state, forces, tau):
    """Inward pass of recursive Newton-Euler in one sample, into ``tau (nv,)``; ``forces (n_joints + 1, 6)`` is scratch.

    A free base gets the whole wrench, about the root's origin.
    """
    n_joints = state.shape[0]
    for j in range(n_joints):
        for i in range(6):
            forces[j, i] = 0.0
    for j in range(n_joints - 1, 0, -1):
        body_wrench(state, j, phi, 10 * (j - 1), forces)
        for i in range(6):
            forces[parents[j], i] += forces[j, i]
        if kinds[j] == FREE_FLYER:
            for i in range(6):
                tau[idx_v[j] + i] = forces[j, i]
            continue
        z0, z1, z2 = state[j, AXIS], state[j, AXIS + 1], state[j, AXIS + 2]
        if kinds[j] == PRISMATIC:
            tau[idx_v[j]] = z0 * forces[j, 0] + z1 * forces[j, 1] + z2 * forces[j, 2]
            continue
        p0, p1, p2 = state[j, POS], state[j, POS + 1], state[j, POS + 2]
        tau[idx_v[j]] = (
            z0 * (forces[j, 3] - p1 * forces[j, 2] + p2 * forces[j, 1])
            + z1 * (forces[j, 4] - p2 * forces[j, 0] + p0 * forces[j, 2])
            + z2 * (forces[j, 5] - p0 * forces[j, 1] + p1 * forces[j, 0])
        )


@LazyKernel
def torques(structure, gravity, q, v, a, phi, state, forces, out):
    """Recursive Newton-Euler; ``forces (n_joints + 1, 6)`` is scratch, ``out (n, nv)``."""
    kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned = structure
    for t in range(q.shape[0]):
        move(
            kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned, gravity, False,
            q[t], v[t], a[t], state,
        )  # fmt: skip
        inward(kinds, parents, idx_v, phi, state, forces, out[t])
