"""Derivatives of regressors: gradients in q, v and a of any weighted sum of a regressor's entries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError
from excite.regressor import adjoint_loops, motion_loops
from excite.regressor.tree import FREE_FLYER, REVOLUTE_UNBOUNDED, KinematicTree, read_tree


@dataclass(frozen=True, eq=False)
class RegressorGradient:
    """Gradients of ``Σ weights · Y`` along a trajectory.

    Attributes:
        q: ``(n, nv)`` in the joints' positions [1/rad or 1/m]; zero for a free base.
        v: ``(n, nv)`` in their velocities.
        a: ``(n, nv)`` in their accelerations.
    """

    q: Array
    v: Array
    a: Array


def regressor_gradient(
    model: pin.Model | KinematicTree, q: Array, v: Array, a: Array, weights: Array
) -> RegressorGradient:
    """Reverse-mode derivative of a regressor.

    One pass costs about as much as three regressors, however many parameters there are.

    Args:
        model: the robot's model; joints with one coordinate, a free base may stand at the root.
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)`` velocities; those of a free base have to be zero.
        a: ``(n, nv)`` accelerations; likewise.
        weights: of the entries of :func:`~excite.regressor.kernels.joint_torque_regressor`
            ``(n, nv, 10·n_segments)``, or of a floating robot those of
            :func:`~excite.regressor.kernels.base_link_regressor`, ``(n, 6, 10·n_segments)``.

    Returns:
        The gradients.

    Raises:
        InputError: wrong shapes, a base that moves, or a joint whose configuration is a cosine and a sine.
    """
    tree = read_tree(model)
    n_rows = 6 if tree.floating else tree.nv
    shapes = ((q, (len(q), tree.nq)), (v, (len(q), tree.nv)), (a, (len(q), tree.nv)))
    if any(np.shape(x) != shape for x, shape in shapes):
        raise InputError("q, v or a of a wrong shape", remedy=f"expected (n, {tree.nq}) and (n, {tree.nv})")
    if weights.shape != (len(q), n_rows, 10 * tree.n_segments):
        raise InputError(f"weights of shape {weights.shape}", remedy="one for each entry of the regressor")
    if (tree.kinds == REVOLUTE_UNBOUNDED).any():
        raise InputError("a joint without limits", field="joints", remedy="give its joint limits in the URDF")
    if tree.floating and (np.any(v[:, :6]) or np.any(a[:, :6])):
        raise InputError("the base moves", field="v", remedy="hold it still")
    row_joint = np.ones(6, dtype=np.int64) if tree.floating else _joint_of_row(tree)
    return _regressor_gradient(tree, q, v, a, row_joint, weights)


def torque_gradient(
    model: pin.Model | KinematicTree, q: Array, v: Array, a: Array, weights: Array
) -> RegressorGradient:
    """Gradients of ``Σ weights · τ`` of the joints' torques by inverse dynamics, model parameters.

    Args:
        model: as for :func:`regressor_gradient`; a free base has to stand still, its own rows do not count.
        q: ``(n, nq)`` configurations.
        v: ``(n, nv)`` velocities.
        a: ``(n, nv)`` accelerations.
        weights: ``(n, n_joints)``, joints in the order of their velocities.

    Raises:
        InputError: as :func:`regressor_gradient`.
    """
    tree = read_tree(model)
    if tree.floating and (np.any(v[:, :6]) or np.any(a[:, :6])):
        raise InputError("the base moves", field="v", remedy="hold it still")
    rows = _joint_of_row(tree)[6 if tree.floating else 0 :]
    # A row that weighs nothing anywhere costs as much as one that does.
    used = np.flatnonzero(np.any(weights, axis=0))
    return _regressor_gradient(tree, q, v, a, rows[used], weights[:, used, None] * tree.phi)


def _regressor_gradient(
    tree: KinematicTree, q: Array, v: Array, a: Array, row_joint: np.ndarray, weights: Array
) -> RegressorGradient:
    q, v, a = (np.ascontiguousarray(x, dtype=float) for x in (q, v, a))
    state = np.empty((len(q), tree.n_segments + 1, motion_loops.STATE_SIZE))
    motion_loops.propagate_motion(tree.structure, tree.gravity, False, q, v, a, state)
    out = np.zeros((3, len(q), tree.nv))
    adjoint_loops.adjoint_gradients(
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
