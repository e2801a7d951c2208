"""Forces, centre of mass and places of a robot's bodies along a motion, which several checks want to know."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.lazy_kernel import LazyKernel
from excite.motion.motion import Motion
from excite.regressor.force_loops import inward_pass
from excite.regressor.kernels import block_of, load_of
from excite.regressor.motion_loops import LANES, POS, by_sample, move_bodies
from excite.regressor.row_loops import write_screw
from excite.regressor.tree import KinematicTree, read_tree
from excite.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Rigid-body quantities at the samples of a motion, world frame.

    Attributes:
        tau: ``(n, nv)`` inverse dynamics without contacts [N·m or N]; of a robot on feet the base's rows are the wrench
            (force, moment) that the ground has to supply, about the world's origin.
        com: ``(n, 3)`` centre of mass [m].
        screws: ``(m, n_joints + 1, 6)`` at the samples asked for, by pinocchio's index: what each joint carries of a
            wrench about the world's origin on what it moves. None of a robot without feet.
        rotation: ``(n, n_feet, 3, 3)`` of the joints that carry the feet.
        position: ``(n, n_feet, 3)`` of the same [m].
    """

    tau: Array
    com: Array
    screws: Array
    rotation: Array
    position: Array


def compute_dynamics(robot: Robot, motion: Motion, asked: NDArray[np.intp]) -> Dynamics:
    """Inverse dynamics of a motion and what comes with it; ``asked`` are the samples at which screws are wanted.

    A robot without feet is left to pinocchio: few samples of an arm are done before compiled loops are loaded. One on
    feet needs those anyway, for its balance, and each of a G1's samples takes them a third of pinocchio's time.
    """
    n, feet, moved = motion.n_samples, robot.feet, (motion.q, motion.v, motion.a)
    found = Dynamics(
        tau=np.empty((n, robot.model.nv)),
        com=np.empty((n, 3)),
        screws=np.zeros((len(asked), robot.model.njoints, 6)) if feet else np.zeros((0, 0, 6)),
        rotation=np.empty((n, len(feet), 3, 3)),
        position=np.empty((n, len(feet), 3)),
    )
    if not feet:
        data = robot.model.createData()
        for k, (q, v, a) in enumerate(zip(*moved, strict=True)):
            found.tau[k] = pin.rnea(robot.model, data, q, v, a)
            found.com[k] = pin.centerOfMass(robot.model, data, q)
        return found
    tree, rows = _kinematic_tree(robot), np.full(n, -1)
    rows[asked] = np.arange(len(asked))
    _stand_on_feet(
        tree.structure, tree.gravity, *(np.ascontiguousarray(part, dtype=float) for part in moved), tree.phi,
        np.array([foot.joint for foot in feet]), rows, *block_of(tree), *load_of(tree),
        found.tau, found.com, found.screws, found.rotation, found.position,
    )  # fmt: skip
    return found


@lru_cache(maxsize=4)
def _kinematic_tree(robot: Robot) -> KinematicTree:
    return read_tree(robot.model)


@LazyKernel
def _stand_on_feet(
    structure, gravity, q, v, a, phi, feet, rows, room, block, state, forces, load,
    tau, com, screws, rotation, position,
):  # fmt: skip
    """Fill in what :class:`Dynamics` has of a robot on feet; arrays from ``room`` to ``load`` are scratch.

    ``rows (n,)`` says which row of ``screws`` is a sample's, none if negative.
    """
    kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned = structure
    for first in range(0, q.shape[0], LANES):
        move_bodies(
            kinds, parents, idx_q, idx_v, rotations, translations, axes, aligned, gravity, True,
            q, v, a, first, room, block,
        )  # fmt: skip
        by_sample(block, state)
        inward_pass(kinds, parents, idx_v, phi, block, forces, load, first, tau)
        for b in range(min(LANES, q.shape[0] - first)):
            t = first + b
            _centre_of_mass(phi, state, b, com[t])
            for k in range(feet.shape[0]):
                for i in range(3):
                    position[t, k, i] = state[b, feet[k], POS + i]
                    for c in range(3):
                        rotation[t, k, i, c] = state[b, feet[k], 3 * i + c]
            if rows[t] >= 0:
                for j in range(1, state.shape[1]):
                    write_screw(kinds[j], state, j, b, screws[rows[t]])


@LazyKernel
def _centre_of_mass(phi, state, b, com):
    """Centre of mass in lane ``b``."""
    mass, x, y, z = 0.0, 0.0, 0.0, 0.0
    for j in range(1, state.shape[1]):
        first = 10 * (j - 1)
        m, hx, hy, hz = phi[first], phi[first + 1], phi[first + 2], phi[first + 3]
        mass += m
        x += m * state[b, j, POS] + state[b, j, 0] * hx + state[b, j, 1] * hy + state[b, j, 2] * hz
        y += m * state[b, j, POS + 1] + state[b, j, 3] * hx + state[b, j, 4] * hy + state[b, j, 5] * hz
        z += m * state[b, j, POS + 2] + state[b, j, 6] * hx + state[b, j, 7] * hy + state[b, j, 8] * hz
    com[0], com[1], com[2] = x / mass, y / mass, z / mass
