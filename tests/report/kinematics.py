"""Poses of a robot's joints from what a page holds, with nothing but numpy."""

from __future__ import annotations

from typing import Any

import numpy as np

from excite.arrays import Array


def rotation(quat: Array) -> Array:
    """Rotation matrix of x y z w."""
    x, y, z, w = np.asarray(quat) / np.linalg.norm(quat)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _pose(turn: Array, place: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, place
    return pose


def poses(scene: dict[str, Any], q: Array) -> list[Array]:
    """``(4, 4)`` of every joint, the world's first."""
    world, at = [np.eye(4)], 0
    for joint in scene["joints"]:
        fixed = _pose(rotation(joint["quat"]), joint["xyz"])
        if joint.get("free"):
            moved = _pose(rotation(q[at + 3 : at + 7]), q[at : at + 3])
            at += 7
        else:
            axis, slide = np.array(joint["turn"]), np.array(joint["slide"])
            half = 0.5 * q[at]
            turn = np.append(np.sin(half) * axis, np.cos(half)) if axis.any() else np.array([0.0, 0, 0, 1])
            moved = _pose(rotation(turn), slide * q[at])
            at += 1
        world.append(world[joint["parent"]] @ fixed @ moved)
    return world
