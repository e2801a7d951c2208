"""Postures between those that are known: positions linearly, rotations on the shortest arc."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from excite.arrays import Array
from excite.human.posture.skeleton import N_SEGMENTS, Pose


def interpolate_poses(at: Array, pose: Pose, wanted: Array) -> Pose:
    """Postures between postures: positions linearly, rotations on the shortest arc.

    Args:
        at: ``(k,)`` rising places of ``pose``.
        pose: ``k`` postures.
        wanted: ``(n,)`` places; outside ``at`` the outermost posture holds.
    """
    wanted = np.clip(wanted, at[0], at[-1])
    if len(at) == 1:
        index = np.zeros(len(wanted), dtype=int)
        return Pose(pose.position[index], pose.rotation[index])
    position = np.column_stack([np.interp(wanted, at, pose.position[:, i]) for i in range(3)])
    rotation = np.stack(
        [Slerp(at, Rotation.from_matrix(pose.rotation[:, k]))(wanted).as_matrix() for k in range(N_SEGMENTS)],
        axis=1,
    )
    return Pose(position, rotation)
