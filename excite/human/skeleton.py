"""Kinematics of the fifteen segments, and the 34 joint angles of the model files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from excite.arrays import Array, Indices
from excite.finding import Finding, list_names
from excite.human.segments import JOINT_NAMES, NAMES, PARENTS, SEGMENTS, segment_ancestors
from excite.logs.signals.base_pose import continuous_quaternions

# Kinematics of the fifteen segments, many frames at a time.

N_SEGMENTS = len(NAMES)


def _velocity_columns() -> tuple[slice, ...]:
    """Columns of each joint in the 40 velocity coordinates: six of the pelvis, then three or one a joint."""
    columns, start = [slice(0, 6)], 6
    for segment in SEGMENTS[1:]:
        columns.append(slice(start, start + len(segment.axes)))
        start += len(segment.axes)
    return tuple(columns)


COLUMNS = _velocity_columns()
N_VELOCITY = COLUMNS[-1].stop
DESCENDANTS: tuple[tuple[int, ...], ...] = tuple(
    tuple(k for k in range(N_SEGMENTS) if joint in segment_ancestors(k)) for joint in range(N_SEGMENTS)
)
REVOLUTE_AXIS = {
    k: np.eye(3)[segment.axes[0].index] * segment.axes[0].sign
    for k, segment in enumerate(SEGMENTS)
    if len(segment.axes) == 1
}


@dataclass(frozen=True, eq=False)
class Pose:
    """Postures of the body, free of singular ones.

    Attributes:
        position: of the pelvis' origin in the world, ``(n, 3)`` [m].
        rotation: of each segment against its parent (of the pelvis in the world), ``(n, 15, 3, 3)``.
    """

    position: Array
    rotation: Array

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, index: Any) -> Pose:
        return Pose(self.position[index], self.rotation[index])

    def copy(self) -> Pose:
        """Postures of their own."""
        return Pose(self.position.copy(), self.rotation.copy())

    def take_step(self, step: Array) -> Pose:
        """Postures after a step ``(n, 40)``: pelvis in the world [m], turns about each segment's own axes [rad]."""
        rotation = self.rotation.copy()
        for k in range(N_SEGMENTS):
            turn = step[:, 3:6] if k == 0 else step[:, COLUMNS[k]]
            if k in REVOLUTE_AXIS:
                turn = turn * REVOLUTE_AXIS[k]
            rotation[:, k] = rotation[:, k] @ Rotation.from_rotvec(turn).as_matrix()
        return replace(self, position=self.position + step[:, :3], rotation=rotation)


def neutral_pose(n: int = 1) -> Pose:
    """Standing upright at the world's origin."""
    return Pose(np.zeros((n, 3)), np.tile(np.eye(3), (n, N_SEGMENTS, 1, 1)))


@dataclass(frozen=True, eq=False)
class Placement:
    """Segments in the world.

    Attributes:
        rotation: ``(n, 15, 3, 3)``.
        origin: ``(n, 15, 3)`` [m].
    """

    rotation: Array
    origin: Array

    def locate_points(self, segment: Indices, local: Array) -> Array:
        """World positions of points ``local`` ``(m, 3)`` fixed to segments ``segment`` ``(m,)``: ``(n, m, 3)``."""
        turned = np.einsum("nmij,mj->nmi", self.rotation[:, segment], local)
        return self.origin[:, segment] + turned


def place_segments(pose: Pose, offsets: Array) -> Placement:
    """Forward kinematics.

    Args:
        pose: postures.
        offsets: each segment's joint in its parent's frame, ``(15, 3)`` [m].
    """
    rotation = np.empty_like(pose.rotation)
    origin = np.empty((len(pose), N_SEGMENTS, 3))
    rotation[:, 0], origin[:, 0] = pose.rotation[:, 0], pose.position
    for k in range(1, N_SEGMENTS):
        parent = PARENTS[k]
        rotation[:, k] = rotation[:, parent] @ pose.rotation[:, k]
        origin[:, k] = origin[:, parent] + rotation[:, parent] @ offsets[k]
    return Placement(rotation, origin)


def point_jacobian(placement: Placement, points: Array, segment: Indices) -> Array:
    """Derivative of points on segments with respect to :meth:`Pose.take_step`'s step, ``(n, m, 3, 40)``.

    Args:
        placement: the segments.
        points: world positions ``(n, m, 3)``.
        segment: which segment carries each, ``(m,)``.
    """
    n, m, _ = points.shape
    jacobian = np.zeros((n, m, 3, N_VELOCITY))
    jacobian[:, :, [0, 1, 2], [0, 1, 2]] = 1.0
    for k in range(N_SEGMENTS):
        carried = np.flatnonzero(np.isin(segment, DESCENDANTS[k]))
        if not len(carried):
            continue
        lever = points[:, carried] - placement.origin[:, k, None]
        if k in REVOLUTE_AXIS:
            axis = placement.rotation[:, k] @ REVOLUTE_AXIS[k]
            jacobian[..., COLUMNS[k].start][:, carried] = np.cross(axis[:, None], lever)
            continue
        start = 3 if k == 0 else COLUMNS[k].start
        for i in range(3):
            axis = placement.rotation[:, k, :, i]
            jacobian[..., start + i][:, carried] = np.cross(axis[:, None], lever)
    return jacobian


# Between postures (rotations) and the 34 joint angles of the model files.


def frame_turn(index: int) -> Array:
    """Rotation from the frame of a segment's last joint axis to the segment's own, ``(3, 3)``."""
    segment = SEGMENTS[index]
    if segment.kind != "upper_arm":
        return np.eye(3)
    inward = 1.0 if segment.side == "right" else -1.0
    # The turn of an upper arm about its own axis ranges from some 60° outwards to 120° inwards; counted from the
    # middle, it keeps clear of the 90° at which the angles are singular.
    return np.asarray(Rotation.from_rotvec([0.0, 0.0, inward * np.radians(30.0)]).as_matrix())


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


def base_pose(pose: Pose) -> Array:
    """The pelvis' pose ``(n, 7)``: x y z [m], qx qy qz qw, signs continuous."""
    quaternion = Rotation.from_matrix(pose.rotation[:, 0]).as_quat()
    return np.hstack([pose.position, continuous_quaternions(quaternion)])


def near_singular(angles: Array, source: str) -> tuple[Finding, ...]:
    """A finding where a middle angle of a spherical joint comes near 90°, where its outer two are ill defined."""
    joints = []
    for segment in SEGMENTS:
        if len(segment.axes) == 3:
            name = f"{segment.joint}_{segment.axes[1].name}"
            worst = np.abs(angles[:, JOINT_NAMES.index(name)]).max()
            if worst > np.radians(80.0):
                joints.append(name)
    if not joints:
        return ()
    text = (
        f"{source}: {list_names(joints)} come within 10° of the posture in which a joint's angles are not unique; "
        "accelerations there are poor"
    )
    return (Finding("near_singular", text, {}, tuple(joints)),)
