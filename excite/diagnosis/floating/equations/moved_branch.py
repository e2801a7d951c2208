"""How the residual changes when a joint and all that it carries are moved in the parent's frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.floating.equations.cross import cross
from excite.diagnosis.floating.equations.state import State


def moved_branch(state: State, joint: int) -> Array:
    """``(n, 6, 3)`` derivative of the residual with respect to the joint's placement along the parent's axes.

    Every body beyond the joint is displaced by r, the same vector, which turns with the parent: their wrench
    at the base gains ``m r''`` and, about the base, ``(Σ m c) × r'' + r × Σ f``. A body's own regressor says
    what r'' is: a unit of its first moment needs the force ``ω' × r + ω × (ω × r)``.

    Args:
        state: where to linearise.
        joint: index in the tree.
    """
    tree, regressor = state.tree, state.regressor
    parent = int(tree.parents[joint])
    base, turn = state.poses.rotation[:, 1], state.poses.rotation[:, parent]
    along = np.einsum("nji,njk->nik", base, turn)
    lifted = regressor[:, :3, 10 * parent - 9 : 10 * parent - 6]
    carried, mass = branch(tree.parents, joint), 0.0
    force, moment = np.zeros((len(state.q), 3)), np.zeros((len(state.q), 3))
    for body in carried:
        block = slice(10 * body - 10, 10 * body)
        phi = state.measured_phi[block]
        if not phi.any():
            continue
        force = force + regressor[:, :3, block] @ phi
        offset = state.poses.translation[:, body] - state.poses.translation[:, 1]
        moment = moment + phi[0] * offset + state.poses.rotation[:, body] @ phi[1:4]
        mass += phi[0]
    out = np.zeros((len(state.q), 6, 3))
    if mass:
        first = np.einsum("nji,nj->ni", base, moment)
        out[:, :3] -= mass * lifted
        out[:, 3:] -= cross(first, lifted) - cross(force, along)
    for sensor in state.record.robot.sensors:
        if sensor.joint in carried:
            rotation = state.poses.rotation[:, sensor.joint] @ state.placements[sensor.name].rotation
            push = np.einsum("nij,nj->ni", rotation, state.readings[sensor.name][:, :3])
            out[:, 3:] -= cross(np.einsum("nji,nj->ni", base, push), along)
    return out


def branch(parents: NDArray[np.int64], joint: int) -> list[int]:
    """A joint and all beyond it, by index in the tree."""
    carried = [joint]
    for index in range(joint + 1, len(parents)):
        if parents[index] in carried:
            carried.append(index)
    return carried
