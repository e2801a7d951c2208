"""How the generalised forces change with where a joint sits in its parent.

Moved by a vector that turns with the parent, all bodies behind the joint keep their rotation and are moved and
accelerated alike; so one recursion of Newton and Euler holds all three directions, without a difference quotient.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError
from excite.lazy_kernel import LazyKernel
from excite.regressor.force_loops import inward_pass
from excite.regressor.kernels import block_of, checked_parameters, checked_trajectory, load_of
from excite.regressor.motion_loops import ALPHA, AXIS, LANES, OMEGA, POS, by_sample, move_bodies
from excite.regressor.tree import FREE_FLYER, PRISMATIC, KinematicTree, read_tree


def placement_gradient(
    model: pin.Model | KinematicTree, joint: str, q: Array, v: Array, a: Array, phi: Array | None = None
) -> Array:
    """Derivative of :func:`~excite.regressor.kernels.inverse_dynamics` with a joint's position in its parent.

    Args:
        model: the robot's model.
        joint: name of a joint, not that of a floating base.
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations.
        phi: ``(10·n_segments,)`` inertial parameters; the model's own if None.

    Returns:
        ``(n, nv, 3)`` [N·m/m or N/m], along the axes of the parent's frame.

    Raises:
        InputError: wrong shape, or no such joint.
    """
    tree = read_tree(model)
    if joint not in tree.names or tree.kinds[tree.names.index(joint)] == FREE_FLYER:
        raise InputError(f"no joint {joint!r} that could be moved", remedy="name one of the model's joints")
    phi = checked_parameters(tree, phi)
    q, v, a = checked_trajectory(tree, q, v, a)
    moved, bodies = tree.names.index(joint), tree.n_segments + 1
    behind = np.zeros(bodies, dtype=bool)
    for j in range(moved, bodies):
        behind[j] = j == moved or behind[tree.parents[j]]
    out = np.zeros((len(q), tree.nv, 3))
    scratch = *block_of(tree), *load_of(tree), np.empty((bodies, 4)), np.empty((len(q), tree.nv))
    placement_gradient_into(tree.structure, tree.gravity, q, v, a, phi, moved, behind, *scratch, out)
    return out


# Compiled loops for how the generalised forces change with a joint's position in its parent.


@LazyKernel
def placement_gradient_into(
    structure, gravity, q, v, a, phi, moved, behind, room, block, state, forces, load, masses, tau, out
):  # fmt: skip
    """Into ``out (n, nv, 3)``, zero before; ``behind (n_joints + 1,)`` says which bodies the joint carries.

    ``masses (n_joints + 1, 4)``, mass and first moment of all that a joint carries, ``tau (n, nv)`` and the arrays from
    ``room`` on are scratch.
    """
    kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned = structure
    for first in range(0, q.shape[0], LANES):
        move_bodies(
            kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned, gravity, False,
            q, v, a, first, room, block,
        )  # fmt: skip
        by_sample(block, state)
        inward_pass(kinds, parents, idx_v, phi, block, forces, load, first, tau)
        for b in range(min(LANES, q.shape[0] - first)):
            _carried_masses(parents, phi, moved, behind, state, b, masses)
            _sample_gradient(kinds, parents, idx_v, moved, behind, state, b, forces, masses, out[first + b])


@LazyKernel
def _sample_gradient(kinds, parents, idx_v, moved, behind, state, b, forces, masses, row):
    """The gradient ``row (nv, 3)`` in lane ``b``."""
    up = parents[moved]
    w0, w1, w2 = state[b, up, OMEGA], state[b, up, OMEGA + 1], state[b, up, OMEGA + 2]
    l0, l1, l2 = state[b, up, ALPHA], state[b, up, ALPHA + 1], state[b, up, ALPHA + 2]
    ww = w0 * w0 + w1 * w1 + w2 * w2
    f0, f1, f2 = forces[moved, b], forces[moved, LANES + b], forces[moved, 2 * LANES + b]
    for k in range(3):
        r0, r1, r2 = state[b, up, k], state[b, up, 3 + k], state[b, up, 6 + k]
        along = w0 * r0 + w1 * r1 + w2 * r2
        a0 = l1 * r2 - l2 * r1 + w0 * along - ww * r0
        a1 = l2 * r0 - l0 * r2 + w1 * along - ww * r1
        a2 = l0 * r1 - l1 * r0 + w2 * along - ww * r2
        # Joints before it carry the force of what has moved on a longer lever; joints behind move along.
        m0, m1, m2 = r1 * f2 - r2 * f1, r2 * f0 - r0 * f2, r0 * f1 - r1 * f0
        j = up
        while j > 0:
            _carried_wrench(kinds[j], state, b, masses[moved], j, a0, a1, a2, m0, m1, m2, row, idx_v[j], k)
            j = parents[j]
        for j in range(moved, state.shape[1]):
            if behind[j]:
                _carried_wrench(kinds[j], state, b, masses[j], j, a0, a1, a2, 0.0, 0.0, 0.0, row, idx_v[j], k)


@LazyKernel
def _carried_masses(parents, phi, moved, behind, state, b, masses):
    """Mass and first moment at the root's origin of all that each joint from ``moved`` on carries."""
    for j in range(state.shape[1]):
        for i in range(4):
            masses[j, i] = 0.0
    for j in range(state.shape[1] - 1, moved - 1, -1):
        if not behind[j]:
            continue
        first = 10 * (j - 1)
        masses[j, 0] += phi[first]
        for i in range(3):
            masses[j, 1 + i] += (
                phi[first] * state[b, j, POS + i]
                + state[b, j, 3 * i] * phi[first + 1]
                + state[b, j, 3 * i + 1] * phi[first + 2]
                + state[b, j, 3 * i + 2] * phi[first + 3]
            )
        if j > moved:
            for i in range(4):
                masses[parents[j], i] += masses[j, i]


@LazyKernel
def _carried_wrench(kind, state, b, mass, j, a0, a1, a2, m0, m1, m2, row, first, k):
    """What joint ``j`` carries of a ``mass (4,)`` accelerated by ``a`` and of a moment ``m``: ``row[first, k]``."""
    p0, p1, p2 = state[b, j, POS], state[b, j, POS + 1], state[b, j, POS + 2]
    h0, h1, h2 = mass[1] - mass[0] * p0, mass[2] - mass[0] * p1, mass[3] - mass[0] * p2
    n0, n1, n2 = m0 + h1 * a2 - h2 * a1, m1 + h2 * a0 - h0 * a2, m2 + h0 * a1 - h1 * a0
    if kind == FREE_FLYER:
        row[first, k], row[first + 1, k], row[first + 2, k] = mass[0] * a0, mass[0] * a1, mass[0] * a2
        row[first + 3, k], row[first + 4, k], row[first + 5, k] = n0, n1, n2
        return
    z0, z1, z2 = state[b, j, AXIS], state[b, j, AXIS + 1], state[b, j, AXIS + 2]
    if kind == PRISMATIC:
        row[first, k] = mass[0] * (z0 * a0 + z1 * a1 + z2 * a2)
    else:
        row[first, k] = z0 * n0 + z1 * n1 + z2 * n2
