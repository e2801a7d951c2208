"""How the generalised forces change with where a joint sits in its parent.

Moved by a vector that turns with the parent, all bodies behind the joint keep their rotation and are moved and
accelerated alike; so one recursion of Newton and Euler holds all three directions, without a difference quotient.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError
from excite.regressor.kernels import block_of, checked_parameters, checked_trajectory, load_of
from excite.regressor.placement_loops import placement_gradient_into
from excite.regressor.tree import FREE_FLYER, KinematicTree, read_tree


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
