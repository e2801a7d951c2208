"""Postures from joint angles: what the joint angles of the package are the inverse of."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from excite.arrays import Array
from excite.human.posture.joint_angles import frame_turn
from excite.human.posture.skeleton import N_SEGMENTS, Pose, exponential
from excite.human.segments import SEGMENTS


def pose_of(base: Array, angles: Array) -> Pose:
    """Postures from the pelvis' pose ``(n, 7)`` (x y z, qx qy qz qw) and joint angles ``(n, 34)``."""
    n = len(base)
    rotation = np.tile(np.eye(3), (n, N_SEGMENTS, 1, 1))
    rotation[:, 0] = Rotation.from_quat(base[:, 3:]).as_matrix()
    column = 0
    for k, segment in enumerate(SEGMENTS):
        for axis in segment.axes:
            turn = np.outer(angles[:, column], np.eye(3)[axis.index] * axis.sign)
            rotation[:, k] = rotation[:, k] @ exponential(turn)
            column += 1
        rotation[:, k] = rotation[:, k] @ frame_turn(k)
    return Pose(base[:, :3].copy(), rotation)
