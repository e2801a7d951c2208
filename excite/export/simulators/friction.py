"""Torques of joints beside their bodies'."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from excite.arrays import Array
from excite.export.models.verification import States
from excite.robot.robot import Robot


def with_friction(robot: Robot, bodies: Array, states: States, drives: Mapping[str, Array]) -> Array:
    """Torques of bodies and drives together, ``(n, nv)``.

    Each joint adds viscous·v + coulomb·sign(v) + armature·a.

    Args:
        robot: the robot.
        bodies: torques of the bodies, ``(n, nv)``.
        states: velocities and accelerations.
        drives: terms, ``(n_joints,)`` each; one that is left out is zero.
    """
    total, base = bodies.copy(), robot.n_base_v
    v, a = states.v[:, base:], states.a[:, base:]
    columns = {"viscous": v, "coulomb": np.sign(v), "armature": a}
    for term, values in drives.items():
        total[:, base:] += columns[term] * values
    return total
