"""Between postures (rotations) and the 34 joint angles of the model files."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from excite.arrays import Array
from excite.finding import Finding, list_names
from excite.human.posture.skeleton import N_SEGMENTS, Pose, rotation_exponential
from excite.human.segments import JOINT_NAMES, SEGMENTS

# The turn of an upper arm about its own axis ranges from some 60° outwards to 120° inwards; counted from the
# middle, it keeps clear of the 90° at which the angles are singular.
SHOULDER_TURN = np.radians(30.0)
_NEAR_SINGULAR = np.radians(80.0)


def frame_turn(index: int) -> Array:
    """Rotation from the frame of a segment's last joint axis to the segment's own, ``(3, 3)``."""
    segment = SEGMENTS[index]
    if segment.kind != "upper_arm":
        return np.eye(3)
    inward = 1.0 if segment.side == "right" else -1.0
    return rotation_exponential(np.array([[0.0, 0.0, inward * SHOULDER_TURN]]))[0]


def joint_angles(pose: Pose) -> Array:
    """Joint angles ``(n, 34)`` [rad], continuous in time, in the order of the segments."""
    columns = []
    for k, segment in enumerate(SEGMENTS):
        if k == 0:
            continue
        rotation = pose.rotation[:, k] @ frame_turn(k).T
        if len(segment.axes) == 1:
            axis = segment.axes[0]
            turn = Rotation.from_matrix(rotation).as_rotvec()[:, axis.index] * axis.sign
            columns.append(np.unwrap(turn))
            continue
        order = "".join("XYZ"[axis.index] for axis in segment.axes)
        angles = Rotation.from_matrix(rotation).as_euler(order)
        columns += list((np.unwrap(angles, axis=0) * [axis.sign for axis in segment.axes]).T)
    return np.column_stack(columns)


def pose_of(base: Array, angles: Array) -> Pose:
    """Postures from the pelvis' pose ``(n, 7)`` (x y z [m], qx qy qz qw) and joint angles ``(n, 34)`` [rad]."""
    n = len(base)
    rotation = np.tile(np.eye(3), (n, N_SEGMENTS, 1, 1))
    rotation[:, 0] = Rotation.from_quat(base[:, 3:]).as_matrix()
    column = 0
    for k, segment in enumerate(SEGMENTS):
        for axis in segment.axes:
            turn = np.outer(angles[:, column], np.eye(3)[axis.index] * axis.sign)
            rotation[:, k] = rotation[:, k] @ rotation_exponential(turn)
            column += 1
        rotation[:, k] = rotation[:, k] @ frame_turn(k)
    return Pose(base[:, :3].copy(), rotation)


def base_pose(pose: Pose) -> Array:
    """The pelvis' pose ``(n, 7)``: x y z [m], qx qy qz qw, signs continuous."""
    quaternion = Rotation.from_matrix(pose.rotation[:, 0]).as_quat()
    flips = np.sign(np.einsum("ni,ni->n", quaternion[1:], quaternion[:-1]))
    signs = np.concatenate([[1.0], np.cumprod(np.where(flips < 0.0, -1.0, 1.0))])
    return np.hstack([pose.position, quaternion * signs[:, None]])


def near_singular(angles: Array, source: str) -> tuple[Finding, ...]:
    """A finding where a middle angle of a spherical joint comes near 90°, where its outer two are ill defined."""
    joints = []
    for segment in SEGMENTS:
        if len(segment.axes) == 3:
            name = f"{segment.joint}_{segment.axes[1].name}"
            worst = np.abs(angles[:, JOINT_NAMES.index(name)]).max()
            if worst > _NEAR_SINGULAR:
                joints.append(name)
    if not joints:
        return ()
    text = (
        f"{source}: {list_names(joints)} come within 10° of the posture in which a joint's angles are not unique; "
        "accelerations there are poor"
    )
    return (Finding("near_singular", text, {}, tuple(joints)),)
