"""The fifteen segments and fourteen joints of the body (Jovic et al., T-RO 2016, section V): 34 degrees of freedom.

Every segment's frame sits in the joint that carries it (the pelvis' midway between the hips) with x forward,
y to the left and z up while the subject stands with hanging arms and palms forward.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from excite.arrays import Array, Indices
from excite.errors import InputError
from excite.logs.signals.base_pose import continuous_quaternions
from excite.results import ADDED, Positive, Stated

SIDES = ("right", "left")
RIGHT, LEFT = SIDES


@dataclass(frozen=True)
class Axis:
    """One angle of a joint: its name's ending, the coordinate axis (0 x, 1 y, 2 z) and the sign of the turn."""

    name: str
    index: int
    sign: float


@dataclass(frozen=True)
class Segment:
    """A segment and the joint that carries it.

    Attributes:
        name: name of the segment and of its link.
        parent: carrying segment, None for the pelvis.
        joint: name of the joint, None for the pelvis.
        axes: its angles, from the parent outwards; three for a spherical joint, one for a revolute one.
        side: ``right``, ``left`` or None.
        kind: name without side, as the tables of inertial parameters have it.
    """

    name: str
    parent: str | None
    joint: str | None
    axes: tuple[Axis, ...]
    side: str | None
    kind: str


def _limb_segments(side: str) -> tuple[Segment, ...]:
    """Arm and leg of a side; angles have the same sense on both (adduction towards the midline, inward turns)."""
    inward = 1.0 if side == RIGHT else -1.0
    hip = (Axis("flexion", 1, -1.0), Axis("adduction", 0, inward), Axis("rotation", 2, inward))
    # The turn about the long axis in the middle keeps the singular posture (90°) out of a shoulder's range,
    # whatever way the arm points; at the wrist pronation comes first.
    shoulder = (Axis("flexion", 1, -1.0), Axis("rotation", 2, inward), Axis("adduction", 0, inward))
    wrist = (Axis("pronation", 2, inward), Axis("deviation", 0, inward), Axis("flexion", 1, -1.0))

    def part(kind: str, parent: str, joint: str, axes: tuple[Axis, ...]) -> Segment:
        carrier = parent if parent in ("torso", "pelvis") else f"{side}_{parent}"
        return Segment(f"{side}_{kind}", carrier, f"{side}_{joint}", axes, side, kind)

    return (
        part("upper_arm", "torso", "shoulder", shoulder),
        part("forearm", "upper_arm", "elbow", (Axis("flexion", 1, -1.0),)),
        part("hand", "forearm", "wrist", wrist),
        part("thigh", "pelvis", "hip", hip),
        part("shank", "thigh", "knee", (Axis("flexion", 1, 1.0),)),
        part("foot", "shank", "ankle", hip),
    )


_SPINE = (Axis("flexion", 1, 1.0), Axis("bending", 0, 1.0), Axis("rotation", 2, 1.0))

SEGMENTS: tuple[Segment, ...] = (
    Segment("pelvis", None, None, (), None, "pelvis"),
    Segment("torso", "pelvis", "lumbar", _SPINE, None, "torso"),
    Segment("head", "torso", "neck", _SPINE, None, "head"),
    *_limb_segments(RIGHT),
    *_limb_segments(LEFT),
)
NAMES: tuple[str, ...] = tuple(segment.name for segment in SEGMENTS)
PARENTS: tuple[int, ...] = tuple(-1 if s.parent is None else NAMES.index(s.parent) for s in SEGMENTS)
PAIRS: tuple[tuple[str, str], ...] = tuple((s.name, f"left_{s.kind}") for s in SEGMENTS if s.side == RIGHT)
JOINT_NAMES: tuple[str, ...] = tuple(
    f"{s.joint}" if len(s.axes) == 1 else f"{s.joint}_{axis.name}" for s in SEGMENTS for axis in s.axes
)
"""The 34 angles, in order of the segments."""


def segment_ancestors(index: int) -> tuple[int, ...]:
    """Indices of a segment and of all that carry it, up to the pelvis."""
    chain = [index]
    while PARENTS[chain[-1]] >= 0:
        chain.append(PARENTS[chain[-1]])
    return tuple(chain)


# Who is measured: mass, height, sex.

Sex = Literal["male", "female"]
_SEXES = ("male", "female")
_MASS, _HEIGHT = (5.0, 400.0), (0.5, 2.6)


@dataclass(frozen=True)
class Subject(Stated):
    """A person.

    Attributes:
        mass: body mass with all that is worn [kg].
        height: stature [m].
        sex: which column of the tables is taken.
    """

    mass: Positive
    height: Positive = field(metadata=ADDED)
    sex: Sex = field(metadata=ADDED)

    def __post_init__(self) -> None:
        """Refuse numbers that no person has.

        Raises:
            InputError: names the number, and the unit that it looks like.
        """
        if not (isfinite(self.mass) and _MASS[0] <= self.mass <= _MASS[1]):
            raise InputError(
                f"is {self.mass} kg", source="subject", field="mass", remedy="give it in kilograms"
            )
        if not (isfinite(self.height) and _HEIGHT[0] <= self.height <= _HEIGHT[1]):
            centimetres = isfinite(self.height) and _HEIGHT[0] <= self.height / 100.0 <= _HEIGHT[1]
            remedy = "these look like centimetres, give metres" if centimetres else "give it in metres"
            raise InputError(f"is {self.height} m", source="subject", field="height", remedy=remedy)
        if self.sex not in _SEXES:
            raise InputError(f"is {self.sex!r}", source="subject", field="sex", remedy="give male or female")


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
