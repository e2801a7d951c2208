"""Compiled loops from the motion of the bodies to the forces at their joints.

``block`` is what :func:`~excite.regressor.motion_loops.move_bodies` fills.
Source: the inward pass of Luh, Walker, Paul (1980).
"""

from __future__ import annotations

from excite.lazy_kernel import LazyKernel
from excite.regressor.motion_loops import ACC, ALPHA, AXIS, LANES, OMEGA, POS, move_bodies
from excite.regressor.tree import FREE_FLYER, PRISMATIC

# Of one body: force, moment and what its joint carries of both, in lanes.
LOAD_SIZE = 7


@LazyKernel
def body_wrench(block, j, phi, first, load):
    """Wrench on body ``j`` at the root's origin for ``phi[first:first + 10]``, into ``load``."""
    m, hx, hy, hz = phi[first], phi[first + 1], phi[first + 2], phi[first + 3]
    xx, xy, yy = phi[first + 4], phi[first + 5], phi[first + 6]
    xz, yz, zz = phi[first + 7], phi[first + 8], phi[first + 9]
    for b in range(LANES):
        r00, r01, r02 = block[j, b], block[j, LANES + b], block[j, 2 * LANES + b]
        r10, r11, r12 = block[j, 3 * LANES + b], block[j, 4 * LANES + b], block[j, 5 * LANES + b]
        r20, r21, r22 = block[j, 6 * LANES + b], block[j, 7 * LANES + b], block[j, 8 * LANES + b]
        p0, p1, p2 = (
            block[j, POS * LANES + b],
            block[j, (POS + 1) * LANES + b],
            block[j, (POS + 2) * LANES + b],
        )
        a0, a1, a2 = (
            block[j, ACC * LANES + b],
            block[j, (ACC + 1) * LANES + b],
            block[j, (ACC + 2) * LANES + b],
        )
        w0, w1 = block[j, OMEGA * LANES + b], block[j, (OMEGA + 1) * LANES + b]
        w2 = block[j, (OMEGA + 2) * LANES + b]
        l0, l1 = block[j, ALPHA * LANES + b], block[j, (ALPHA + 1) * LANES + b]
        l2 = block[j, (ALPHA + 2) * LANES + b]
        h0, h1 = r00 * hx + r01 * hy + r02 * hz, r10 * hx + r11 * hy + r12 * hz
        h2 = r20 * hx + r21 * hy + r22 * hz
        d, ww = w0 * h0 + w1 * h1 + w2 * h2, w0 * w0 + w1 * w1 + w2 * w2
        f0 = m * a0 + l1 * h2 - l2 * h1 + w0 * d - ww * h0
        f1 = m * a1 + l2 * h0 - l0 * h2 + w1 * d - ww * h1
        f2 = m * a2 + l0 * h1 - l1 * h0 + w2 * d - ww * h2
        # Inertia: I·alpha + w × I·w in the body's frame.
        lx, ly = r00 * l0 + r10 * l1 + r20 * l2, r01 * l0 + r11 * l1 + r21 * l2
        lz = r02 * l0 + r12 * l1 + r22 * l2
        wx, wy = r00 * w0 + r10 * w1 + r20 * w2, r01 * w0 + r11 * w1 + r21 * w2
        wz = r02 * w0 + r12 * w1 + r22 * w2
        ix, iy, iz = xx * wx + xy * wy + xz * wz, xy * wx + yy * wy + yz * wz, xz * wx + yz * wy + zz * wz
        nx = xx * lx + xy * ly + xz * lz + wy * iz - wz * iy
        ny = xy * lx + yy * ly + yz * lz + wz * ix - wx * iz
        nz = xz * lx + yz * ly + zz * lz + wx * iy - wy * ix
        load[b], load[LANES + b], load[2 * LANES + b] = f0, f1, f2
        load[3 * LANES + b] = r00 * nx + r01 * ny + r02 * nz + h1 * a2 - h2 * a1 + p1 * f2 - p2 * f1
        load[4 * LANES + b] = r10 * nx + r11 * ny + r12 * nz + h2 * a0 - h0 * a2 + p2 * f0 - p0 * f2
        load[5 * LANES + b] = r20 * nx + r21 * ny + r22 * nz + h0 * a1 - h1 * a0 + p0 * f1 - p1 * f0


@LazyKernel
def joint_force(kind, block, j, load):
    """What joint ``j`` carries of the wrench in ``load``, into its last row."""
    for b in range(LANES):
        z0, z1 = block[j, AXIS * LANES + b], block[j, (AXIS + 1) * LANES + b]
        z2 = block[j, (AXIS + 2) * LANES + b]
        f0, f1, f2 = load[b], load[LANES + b], load[2 * LANES + b]
        if kind == PRISMATIC:
            force = z0 * f0 + z1 * f1 + z2 * f2
        else:
            p0, p1 = block[j, POS * LANES + b], block[j, (POS + 1) * LANES + b]
            p2 = block[j, (POS + 2) * LANES + b]
            force = (
                z0 * (load[3 * LANES + b] - p1 * f2 + p2 * f1)
                + z1 * (load[4 * LANES + b] - p2 * f0 + p0 * f2)
                + z2 * (load[5 * LANES + b] - p0 * f1 + p1 * f0)
            )
        load[6 * LANES + b] = force


@LazyKernel
def add_up(j, parent, load, forces):
    """Add to a body's own wrench what its joints carry, and both to what its parent's carries: into ``load``, too."""
    # A loop each: the compiler does not know that two bodies' forces are apart.
    for i in range(6 * LANES):
        load[i] += forces[j, i]
    for i in range(6 * LANES):
        forces[j, i] = load[i]
    for i in range(6 * LANES):
        forces[parent, i] += load[i]


@LazyKernel
def inward_pass(kinds, parents, idx_v, phi, block, forces, load, first, tau):
    """Inward pass of recursive Newton-Euler, into ``tau (n, nv)`` from sample ``first`` on.

    Into ``forces (n_joints + 1, 6 * LANES)`` comes the wrench (force, moment) at the root's origin of all that each
    joint carries; a free base gets the whole of it. ``load (LOAD_SIZE * LANES)`` is scratch.
    """
    count = min(LANES, tau.shape[0] - first)
    for j in range(forces.shape[0]):
        for i in range(6 * LANES):
            forces[j, i] = 0.0
    for j in range(forces.shape[0] - 1, 0, -1):
        body_wrench(block, j, phi, 10 * (j - 1), load)
        add_up(j, parents[j], load, forces)
        if kinds[j] == FREE_FLYER:
            for i in range(6):
                for b in range(count):
                    tau[first + b, idx_v[j] + i] = load[i * LANES + b]
            continue
        joint_force(kinds[j], block, j, load)
        for b in range(count):
            tau[first + b, idx_v[j]] = load[6 * LANES + b]


@LazyKernel
def joint_torques_into(structure, gravity, q, v, a, phi, room, block, forces, load, out):
    """Recursive Newton-Euler, into ``out (n, nv)``; arrays before it are scratch."""
    kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned = structure
    for first in range(0, q.shape[0], LANES):
        move_bodies(
            kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned, gravity, False,
            q, v, a, first, room, block,
        )  # fmt: skip
        inward_pass(kinds, parents, idx_v, phi, block, forces, load, first, out)
