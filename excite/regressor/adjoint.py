"""Derivatives of regressors: gradients in q, v and a of any weighted sum of a regressor's entries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import InputError
from excite.lazy_kernel import LazyKernel
from excite.regressor import motion_loops
from excite.regressor.motion_loops import ACC, AXIS, POS
from excite.regressor.tree import FREE_FLYER, PRISMATIC, REVOLUTE_UNBOUNDED, KinematicTree, read_tree


@dataclass(frozen=True, eq=False)
class RegressorGradient:
    """Gradients of ``Σ weights · Y`` along a trajectory.

    Attributes:
        q: ``(n, nv)`` in the joints' positions [1/rad or 1/m], and in a free base's turn about its own axes.
        v: ``(n, nv)`` in their velocities.
        a: ``(n, nv)`` in their accelerations.
    """

    q: Array
    v: Array
    a: Array


def regressor_gradient(
    model: pin.Model | KinematicTree,
    q: Array,
    v: Array,
    a: Array,
    weights: Array,
    joints: Sequence[int] | NDArray[np.intp] = (),
) -> RegressorGradient:
    """Reverse-mode derivative of a regressor.

    One pass costs about as much as three regressors, however many parameters there are.

    Args:
        model: the robot's model; joints with one coordinate, a free base may stand at the root.
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations.
        weights: of the entries of :func:`~excite.regressor.kernels.joint_torque_regressor`
            ``(n, nv, 10·n_segments)``, or of a floating robot those of
            :func:`~excite.regressor.kernels.base_link_regressor`, ``(n, 6, 10·n_segments)``, then those of the
            torques of ``joints``.
        joints: of a floating robot's model.

    Returns:
        The gradients.

    Raises:
        InputError: wrong shapes, or a joint whose configuration is a cosine and a sine.
    """
    tree = read_tree(model)
    row_joint = np.array([1] * 6 + list(joints), dtype=np.int64) if tree.floating else _joint_of_row(tree)
    shapes = ((q, (len(q), tree.nq)), (v, (len(q), tree.nv)), (a, (len(q), tree.nv)))
    if any(np.shape(x) != shape for x, shape in shapes):
        raise InputError("q, v or a of a wrong shape", remedy=f"expected (n, {tree.nq}) and (n, {tree.nv})")
    if weights.shape != (len(q), len(row_joint), 10 * tree.n_segments):
        raise InputError(f"weights of shape {weights.shape}", remedy="one for each entry of the regressor")
    if (tree.kinds == REVOLUTE_UNBOUNDED).any():
        raise InputError("a joint without limits", field="joints", remedy="give its joint limits in the URDF")
    return _regressor_gradient(tree, q, v, a, row_joint, weights)


def _regressor_gradient(
    tree: KinematicTree, q: Array, v: Array, a: Array, row_joint: np.ndarray, weights: Array
) -> RegressorGradient:
    q, v, a = (np.ascontiguousarray(x, dtype=float) for x in (q, v, a))
    state = np.empty((len(q), tree.n_segments + 1, motion_loops.STATE_SIZE))
    motion_loops.propagate_motion(tree.structure, tree.gravity, False, q, v, a, state)
    out = np.zeros((3, len(q), tree.nv))
    adjoint_gradients(
        tree.kinds, tree.parents, tree.idx_v, v, a, state, row_joint, np.ascontiguousarray(weights),
        _ancestor_matrix(tree), out[0], out[1], out[2],
    )  # fmt: skip
    return RegressorGradient(*out)


def _joint_of_row(tree: KinematicTree) -> np.ndarray:
    rows = np.zeros(tree.nv, dtype=np.int64)
    for joint in range(1, tree.n_segments + 1):
        if tree.kinds[joint] != FREE_FLYER:
            rows[tree.idx_v[joint]] = joint
    return rows


def _ancestor_matrix(tree: KinematicTree) -> np.ndarray:
    """Whether joint i carries joint j, or is it, ``(n_joints + 1, n_joints + 1)``; the universe carries all."""
    above = np.eye(tree.n_segments + 1, dtype=bool)
    for joint in range(1, tree.n_segments + 1):
        above[:, joint] |= above[:, tree.parents[joint]]
    return above


# Compiled loop of the regressor's adjoint: from weights of its entries to gradients in q, v and a.
#
# With weights ``G`` the scalar is ``C = Σ G_rk Y_rk = Σ_r Σ_b s_r · f_b(g_br)``: body ``b`` with the ten
# numbers ``g_br`` of row ``r`` as its inertial parameters, its wrench ``f_b = I a + v ×* I v`` projected on
# the row's axis ``s_r``. Spatial vectors (angular part first) stand in the root frame of
# :mod:`excite.regressor.motion_loops`, where turning joint k moves all that it carries rigidly, and what
# moves together with its axis cancels. Derivatives of spatial velocity and acceleration: Carpentier and
# Mansard (2018), section III.


@LazyKernel
def cross_motion(v, m, out):
    """``out = v × m`` of two motions."""
    out[0] = v[1] * m[2] - v[2] * m[1]
    out[1] = v[2] * m[0] - v[0] * m[2]
    out[2] = v[0] * m[1] - v[1] * m[0]
    out[3] = v[1] * m[5] - v[2] * m[4] + v[4] * m[2] - v[5] * m[1]
    out[4] = v[2] * m[3] - v[0] * m[5] + v[5] * m[0] - v[3] * m[2]
    out[5] = v[0] * m[4] - v[1] * m[3] + v[3] * m[1] - v[4] * m[0]


@LazyKernel
def add_cross_force(scale, v, f, out):
    """``out += scale · v ×* f`` of a motion and a force (moment first)."""
    out[0] += scale * (v[1] * f[2] - v[2] * f[1] + v[4] * f[5] - v[5] * f[4])
    out[1] += scale * (v[2] * f[0] - v[0] * f[2] + v[5] * f[3] - v[3] * f[5])
    out[2] += scale * (v[0] * f[1] - v[1] * f[0] + v[3] * f[4] - v[4] * f[3])
    out[3] += scale * (v[1] * f[5] - v[2] * f[4])
    out[4] += scale * (v[2] * f[3] - v[0] * f[5])
    out[5] += scale * (v[0] * f[4] - v[1] * f[3])


@LazyKernel
def to_body(s, m, out):
    """A motion in the frame of the body with state ``s``, at its origin."""
    l0 = m[3] + m[1] * s[POS + 2] - m[2] * s[POS + 1]
    l1 = m[4] + m[2] * s[POS] - m[0] * s[POS + 2]
    l2 = m[5] + m[0] * s[POS + 1] - m[1] * s[POS]
    for i in range(3):
        out[i] = s[i] * m[0] + s[3 + i] * m[1] + s[6 + i] * m[2]
        out[3 + i] = s[i] * l0 + s[3 + i] * l1 + s[6 + i] * l2


@LazyKernel
def add_to_root(s, f, out):
    """Add a force of the body's frame, brought to the root frame."""
    f0 = s[0] * f[3] + s[1] * f[4] + s[2] * f[5]
    f1 = s[3] * f[3] + s[4] * f[4] + s[5] * f[5]
    f2 = s[6] * f[3] + s[7] * f[4] + s[8] * f[5]
    p0, p1, p2 = s[POS], s[POS + 1], s[POS + 2]
    out[0] += s[0] * f[0] + s[1] * f[1] + s[2] * f[2] + p1 * f2 - p2 * f1
    out[1] += s[3] * f[0] + s[4] * f[1] + s[5] * f[2] + p2 * f0 - p0 * f2
    out[2] += s[6] * f[0] + s[7] * f[1] + s[8] * f[2] + p0 * f1 - p1 * f0
    out[3] += f0
    out[4] += f1
    out[5] += f2


@LazyKernel
def multiply_inertia(g, m, out):
    """``out = I(g) m`` with ``g`` in the order m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz."""
    out[0] = g[4] * m[0] + g[5] * m[1] + g[7] * m[2] + g[2] * m[5] - g[3] * m[4]
    out[1] = g[5] * m[0] + g[6] * m[1] + g[8] * m[2] + g[3] * m[3] - g[1] * m[5]
    out[2] = g[7] * m[0] + g[8] * m[1] + g[9] * m[2] + g[1] * m[4] - g[2] * m[3]
    out[3] = g[0] * m[3] + m[1] * g[3] - m[2] * g[2]
    out[4] = g[0] * m[4] + m[2] * g[1] - m[0] * g[3]
    out[5] = g[0] * m[5] + m[0] * g[2] - m[1] * g[1]


@LazyKernel
def spatial_motion(kinds, parents, idx_v, v, a, state, axes, rates, vel, acc):
    """Axes, their rates, velocities and accelerations (less gravity) of all bodies, each ``(n_joints + 1, 6)``."""
    for i in range(6):
        vel[0, i] = acc[0, i] = 0.0
    for i in range(3):
        acc[0, 3 + i] = state[0, ACC + i]
    for j in range(1, kinds.shape[0]):
        s, up = state[j], parents[j]
        if kinds[j] == FREE_FLYER:
            # Its twist stands linear part first in v, and its state holds the acceleration of a point.
            for i in range(3):
                axes[j, i] = axes[j, 3 + i] = rates[j, i] = rates[j, 3 + i] = 0.0
                vel[j, i], vel[j, 3 + i] = v[3 + i], v[i]
                acc[j, i] = a[3 + i]
                k, m = (i + 1) % 3, (i + 2) % 3
                acc[j, 3 + i] = s[ACC + i] - (v[3 + k] * v[m] - v[3 + m] * v[k])
            continue
        z0, z1, z2 = s[AXIS], s[AXIS + 1], s[AXIS + 2]
        if kinds[j] == PRISMATIC:
            axes[j, 0] = axes[j, 1] = axes[j, 2] = 0.0
            axes[j, 3], axes[j, 4], axes[j, 5] = z0, z1, z2
        else:
            p0, p1, p2 = s[POS], s[POS + 1], s[POS + 2]
            axes[j, 0], axes[j, 1], axes[j, 2] = z0, z1, z2
            axes[j, 3], axes[j, 4], axes[j, 5] = p1 * z2 - p2 * z1, p2 * z0 - p0 * z2, p0 * z1 - p1 * z0
        cross_motion(vel[up], axes[j], rates[j])
        for i in range(6):
            vel[j, i] = vel[up, i] + axes[j, i] * v[idx_v[j]]
            acc[j, i] = acc[up, i] + axes[j, i] * a[idx_v[j]] + rates[j, i] * v[idx_v[j]]


@LazyKernel
def body_adjoint(g, s, axis, v, a, work, pull_a, pull_v, force):
    """Add what one body and one row contribute, in the body's frame.

    ``v, a`` are the body's own; ``work (5, 6)`` is scratch; ``pull_a`` and ``pull_v`` are the gradients in its
    acceleration and velocity, ``force`` its wrench in the root frame.
    """
    own, h, u = work[0], work[1], work[2]
    to_body(s, axis, own)
    multiply_inertia(g, v, h)
    cross_motion(v, own, u)
    multiply_inertia(g, a, work[3])
    add_cross_force(1.0, v, h, work[3])
    add_to_root(s, work[3], force)
    multiply_inertia(g, own, work[3])
    multiply_inertia(g, u, work[4])
    for i in range(6):
        pull_a[i] += work[3][i]
        pull_v[i] -= work[4][i]
    add_cross_force(-1.0, own, h, pull_v)


@LazyKernel
def joint_gradient(
    axis, rate, vel, acc, pulls, forces, row_axes, row_joint, carries, work, column, out_q, out_v, out_a
):
    """Gradients in one joint's coordinate from what its subtree pulls; ``vel, acc`` are those of its parent."""
    pull_a, pull_v, moved = pulls[0], pulls[1], work[0]
    for i in range(6):
        moved[i] = pulls[2, i]
        work[1, i] = 0.0
    add_cross_force(-1.0, vel, pull_a, moved)
    add_cross_force(-1.0, vel, pull_v, work[1])
    add_cross_force(-1.0, acc, pull_a, work[1])
    for r in range(row_joint.shape[0]):
        if carries[row_joint[r]]:
            add_cross_force(-1.0, row_axes[r], forces[r], work[1])
    q_sum, v_sum, a_sum = 0.0, 0.0, 0.0
    for i in range(6):
        q_sum += axis[i] * work[1, i] + rate[i] * moved[i]
        v_sum += axis[i] * (pull_v[i] + moved[i]) + rate[i] * pull_a[i]
        a_sum += axis[i] * pull_a[i]
    out_q[column], out_v[column], out_a[column] = q_sum, v_sum, a_sum


@LazyKernel
def base_gradient(vel, acc, a, pulls, moved, out_q, out_v, out_a):
    """Gradients in a free base's turn, velocity and acceleration from what the whole robot pulls, in its frame."""
    pull_a, pull_v = pulls[0], pulls[1]
    for i in range(6):
        moved[i] = pulls[2, i] + pull_v[i]
    add_cross_force(-1.0, vel, pull_a, moved)
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        out_v[i], out_v[3 + i] = moved[3 + i], moved[i]
        out_a[i], out_a[3 + i] = pull_a[3 + i], pull_a[i]
        # Gravity in the base's frame is what the acceleration lacks.
        out_q[3 + i] = (a[k] - acc[3 + k]) * pull_a[3 + m] - (a[m] - acc[3 + m]) * pull_a[3 + k]


@LazyKernel
def subtree_pulls(
    parents, state, row_axes, row_joint, vel, acc, weights, above, own, work, local, pulls, forces
):
    """What each body alone pulls: gradients in its acceleration and velocity, and its wrench by row."""
    pulls[:] = 0.0
    forces[:] = 0.0
    for b in range(1, parents.shape[0]):
        s = state[b]
        to_body(s, vel[b], own[0])
        to_body(s, acc[b], own[1])
        local[:] = 0.0
        for r in range(row_joint.shape[0]):
            if above[row_joint[r], b]:
                g = weights[r, 10 * (b - 1) : 10 * b]
                body_adjoint(g, s, row_axes[r], own[0], own[1], work, local[0], local[1], forces[b, r])
        add_cross_force(1.0, own[0], local[0], local[2])
        for k in range(3):
            add_to_root(s, local[k], pulls[k, b])


@LazyKernel
def gather_to_parent(body, parent, pulls, forces):
    """Add a subtree's pulls and wrenches to its parent's."""
    for i in range(6):
        for k in range(3):
            pulls[k, parent, i] += pulls[k, body, i]
        for r in range(forces.shape[1]):
            forces[parent, r, i] += forces[body, r, i]


@LazyKernel
def adjoint_gradients(kinds, parents, idx_v, v, a, state, row_joint, weights, above, out_q, out_v, out_a):
    """Gradients ``(n, nv)`` of ``Σ weights · Y``.

    ``weights`` is ``(n, n_rows, 10·n_segments)``; ``row_joint (n_rows,)`` the joint of each row, of a free base six
    times 1 (force rows first); ``above (n_joints + 1, n_joints + 1)`` whether one joint carries another or is it.
    """
    n, n_rows = kinds.shape[0], row_joint.shape[0]
    axes, rates = np.zeros((n, 6)), np.zeros((n, 6))
    vel, acc = np.empty((n, 6)), np.empty((n, 6))
    own, work = np.empty((2, 6)), np.empty((5, 6))
    local, pulls = np.empty((3, 6)), np.empty((3, n, 6))
    forces, row_axes = np.empty((n, n_rows, 6)), np.zeros((n_rows, 6))
    for t in range(state.shape[0]):
        spatial_motion(kinds, parents, idx_v, v[t], a[t], state[t], axes, rates, vel, acc)
        for r in range(n_rows):
            # A loop: of the assignment of one slice to another numba compiles its refusal, too, for two seconds.
            for i in range(6):
                row_axes[r, i] = axes[row_joint[r], i]
            if kinds[row_joint[r]] == FREE_FLYER:
                row_axes[r, r + 3 if r < 3 else r - 3] = 1.0
        subtree_pulls(
            parents,
            state[t],
            row_axes,
            row_joint,
            vel,
            acc,
            weights[t],
            above,
            own,
            work,
            local,
            pulls,
            forces,
        )
        for b in range(n - 1, 0, -1):
            up = parents[b]
            if kinds[b] == FREE_FLYER:
                base_gradient(vel[b], acc[b], a[t], pulls[:, b], work[0], out_q[t], out_v[t], out_a[t])
            else:
                joint_gradient(
                    axes[b], rates[b], vel[up], acc[up], pulls[:, b], forces[b], row_axes, row_joint,
                    above[:, up], work, idx_v[b], out_q[t], out_v[t], out_a[t],
                )  # fmt: skip
            gather_to_parent(b, up, pulls, forces)
