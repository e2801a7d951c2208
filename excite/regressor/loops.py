"""Compiled loops from the motion of the bodies to wrenches: regressors and inverse dynamics.

``state`` is what :mod:`excite.regressor.motion_loops` fills. Sources: the regressor of one body, Atkeson, An,
Hollerbach (1986), eq. 9-11; the inward pass, Luh, Walker, Paul (1980).
"""

from __future__ import annotations

from excite.lazy_kernel import LazyKernel
from excite.regressor.motion_loops import ACC, ALPHA, AXIS, OMEGA, POS
from excite.regressor.tree import FREE_FLYER, PRISMATIC


@LazyKernel
def body_rows(s, out, first):
    """Regressor of one body's wrench at the root's origin, into ``out[:, first:first + 10]``."""
    p0, p1, p2 = s[POS], s[POS + 1], s[POS + 2]
    w0, w1, w2 = s[OMEGA], s[OMEGA + 1], s[OMEGA + 2]
    l0, l1, l2 = s[ALPHA], s[ALPHA + 1], s[ALPHA + 2]
    a0, a1, a2 = s[ACC], s[ACC + 1], s[ACC + 2]
    out[0, first], out[1, first], out[2, first] = a0, a1, a2
    out[3, first] = p1 * a2 - p2 * a1
    out[4, first] = p2 * a0 - p0 * a2
    out[5, first] = p0 * a1 - p1 * a0
    for k in range(3):
        x0, x1, x2 = s[k], s[3 + k], s[6 + k]
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
        s[0] * l0 + s[3] * l1 + s[6] * l2,
        s[1] * l0 + s[4] * l1 + s[7] * l2,
        s[2] * l0 + s[5] * l1 + s[8] * l2,
    )
    wx, wy, wz = (
        s[0] * w0 + s[3] * w1 + s[6] * w2,
        s[1] * w0 + s[4] * w1 + s[7] * w2,
        s[2] * w0 + s[5] * w1 + s[8] * w2,
    )
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        wj, wk = s[OMEGA + j], s[OMEGA + k]
        x, y, z = s[3 * i], s[3 * i + 1], s[3 * i + 2]
        cx = wj * s[3 * k] - wk * s[3 * j]
        cy = wj * s[3 * k + 1] - wk * s[3 * j + 1]
        cz = wj * s[3 * k + 2] - wk * s[3 * j + 2]
        out[3 + i, first + 4] = x * lx + cx * wx
        out[3 + i, first + 5] = x * ly + y * lx + cx * wy + cy * wx
        out[3 + i, first + 6] = y * ly + cy * wy
        out[3 + i, first + 7] = x * lz + z * lx + cx * wz + cz * wx
        out[3 + i, first + 8] = y * lz + z * ly + cy * wz + cz * wy
        out[3 + i, first + 9] = z * lz + cz * wz


@LazyKernel
def base_rows(state, out):
    """Wrench regressor of all bodies at the root's origin; ``out (n, 6, 10·n_segments)``."""
    for t in range(state.shape[0]):
        for j in range(1, state.shape[1]):
            body_rows(state[t, j], out[t], 10 * (j - 1))


@LazyKernel
def project(kind, s, wrench, first, out):
    """What a joint with state ``s`` carries of a body's wrench regressor, into its rows of ``out``."""
    if kind == FREE_FLYER:
        for i in range(6):
            for k in range(first, first + 10):
                out[i, k] = wrench[i, k]
        return
    z0, z1, z2 = s[AXIS], s[AXIS + 1], s[AXIS + 2]
    # The joint's wrench at the root: a pure force along a prismatic axis, else the axis' line about the root.
    m0, m1, m2 = z0, z1, z2
    if kind != PRISMATIC:
        p0, p1, p2 = s[POS], s[POS + 1], s[POS + 2]
        m0, m1, m2 = p1 * z2 - p2 * z1, p2 * z0 - p0 * z2, p0 * z1 - p1 * z0
        for k in range(first, first + 10):
            out[0, k] = z0 * wrench[3, k] + z1 * wrench[4, k] + z2 * wrench[5, k]
    for k in range(first, first + 4):
        out[0, k] += m0 * wrench[0, k] + m1 * wrench[1, k] + m2 * wrench[2, k]


@LazyKernel
def torque_rows(kinds, parents, idx_v, state, wrench, out):
    """Joint torque regressor; ``wrench (6, 10·n_segments)`` is scratch, ``out (n, nv, 10·n_segments)``."""
    for t in range(state.shape[0]):
        for i in range(out.shape[1]):
            for k in range(out.shape[2]):
                out[t, i, k] = 0.0
        for body in range(1, state.shape[1]):
            first = 10 * (body - 1)
            body_rows(state[t, body], wrench, first)
            j = body
            while j > 0:
                project(kinds[j], state[t, j], wrench, first, out[t, idx_v[j] :])
                j = parents[j]


@LazyKernel
def body_wrench(s, phi, first, total):
    """Wrench on one body at the root's origin for ``phi[first:first + 10]``, added to ``total (6,)``."""
    m = phi[first]
    h0 = s[0] * phi[first + 1] + s[1] * phi[first + 2] + s[2] * phi[first + 3]
    h1 = s[3] * phi[first + 1] + s[4] * phi[first + 2] + s[5] * phi[first + 3]
    h2 = s[6] * phi[first + 1] + s[7] * phi[first + 2] + s[8] * phi[first + 3]
    w0, w1, w2 = s[OMEGA], s[OMEGA + 1], s[OMEGA + 2]
    l0, l1, l2 = s[ALPHA], s[ALPHA + 1], s[ALPHA + 2]
    a0, a1, a2 = s[ACC], s[ACC + 1], s[ACC + 2]
    d, ww = w0 * h0 + w1 * h1 + w2 * h2, w0 * w0 + w1 * w1 + w2 * w2
    f0 = m * a0 + l1 * h2 - l2 * h1 + w0 * d - ww * h0
    f1 = m * a1 + l2 * h0 - l0 * h2 + w1 * d - ww * h1
    f2 = m * a2 + l0 * h1 - l1 * h0 + w2 * d - ww * h2
    xx, xy, yy = phi[first + 4], phi[first + 5], phi[first + 6]
    xz, yz, zz = phi[first + 7], phi[first + 8], phi[first + 9]
    lx, ly, lz = (
        s[0] * l0 + s[3] * l1 + s[6] * l2,
        s[1] * l0 + s[4] * l1 + s[7] * l2,
        s[2] * l0 + s[5] * l1 + s[8] * l2,
    )
    wx, wy, wz = (
        s[0] * w0 + s[3] * w1 + s[6] * w2,
        s[1] * w0 + s[4] * w1 + s[7] * w2,
        s[2] * w0 + s[5] * w1 + s[8] * w2,
    )
    ix, iy, iz = xx * wx + xy * wy + xz * wz, xy * wx + yy * wy + yz * wz, xz * wx + yz * wy + zz * wz
    nx = xx * lx + xy * ly + xz * lz + wy * iz - wz * iy
    ny = xy * lx + yy * ly + yz * lz + wz * ix - wx * iz
    nz = xz * lx + yz * ly + zz * lz + wx * iy - wy * ix
    p0, p1, p2 = s[POS], s[POS + 1], s[POS + 2]
    total[0] += f0
    total[1] += f1
    total[2] += f2
    total[3] += s[0] * nx + s[1] * ny + s[2] * nz + h1 * a2 - h2 * a1 + p1 * f2 - p2 * f1
    total[4] += s[3] * nx + s[4] * ny + s[5] * nz + h2 * a0 - h0 * a2 + p2 * f0 - p0 * f2
    total[5] += s[6] * nx + s[7] * ny + s[8] * nz + h0 * a1 - h1 * a0 + p0 * f1 - p1 * f0


@LazyKernel
def torques(kinds, parents, idx_v, state, phi, forces, out):
    """Recursive Newton-Euler; ``forces (n_joints + 1, 6)`` is scratch, ``out (n, nv)``."""
    n_joints = state.shape[1]
    for t in range(state.shape[0]):
        for j in range(n_joints):
            for i in range(6):
                forces[j, i] = 0.0
        for j in range(n_joints - 1, 0, -1):
            s, f = state[t, j], forces[j]
            body_wrench(s, phi, 10 * (j - 1), f)
            for i in range(6):
                forces[parents[j], i] += f[i]
            if kinds[j] == FREE_FLYER:
                for i in range(6):
                    out[t, idx_v[j] + i] = f[i]
                continue
            z0, z1, z2 = s[AXIS], s[AXIS + 1], s[AXIS + 2]
            if kinds[j] == PRISMATIC:
                out[t, idx_v[j]] = z0 * f[0] + z1 * f[1] + z2 * f[2]
                continue
            p0, p1, p2 = s[POS], s[POS + 1], s[POS + 2]
            out[t, idx_v[j]] = (
                z0 * (f[3] - p1 * f[2] + p2 * f[1])
                + z1 * (f[4] - p2 * f[0] + p0 * f[2])
                + z2 * (f[5] - p0 * f[1] + p1 * f[0])
            )
