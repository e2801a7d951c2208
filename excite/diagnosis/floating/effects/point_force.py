"""Forces at a point of a link."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.equations.cross import cross
from excite.diagnosis.floating.equations.state import State


def columns_of_force(state: State, joint: int, point: Array, force: Array, change: Array, at: slice) -> Array:
    """Minus the derivative of the residual, ``(n, 6, k)``, of a force whose point is a parameter as well.

    Args:
        state: where to linearise.
        joint: of the link, index in the tree.
        point: ``(n, 3)`` where it acts, world [m].
        force: ``(n, 3)`` world [N].
        change: ``(n, 3, k)`` its derivative by each parameter.
        at: the three parameters that are the point's coordinates in the joint's frame.
    """
    columns = -state.at_base(change, point)
    base = state.poses.rotation[:, 1]
    turned = np.einsum("nji,nj->ni", base, force)
    columns[:, 3:, at] += cross(turned, base.transpose(0, 2, 1) @ state.poses.rotation[:, joint])
    return columns
