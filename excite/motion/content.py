"""What a motion holds, as columns by name, and the hash that tells whether it changed."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array

if TYPE_CHECKING:
    # A child process that reads a bag needs the names alone, and no robot.
    from excite.motion.motion import Motion

BASE_POSE = tuple(f"base.{name}" for name in ("px", "py", "pz", "qx", "qy", "qz", "qw"))
BASE_TWIST = tuple(f"base.{name}" for name in ("vx", "vy", "vz", "wx", "wy", "wz"))
BASE_ACCELERATION = tuple(f"base.{name}" for name in ("ax", "ay", "az", "alphax", "alphay", "alphaz"))
# Quaternions nearer to unit length are left as they are, so that reading what was written changes no bit of them.
_UNIT = 1e-9


def motion_columns(motion: Motion) -> dict[str, Array]:
    """Columns of a motion's file, by name, in order."""
    columns: dict[str, Array] = {"time": motion.time}
    if motion.floating:
        columns |= {name: motion.q[:, i] for i, name in enumerate(BASE_POSE)}
        columns |= {name: motion.v[:, i] for i, name in enumerate(BASE_TWIST)}
        columns |= {name: motion.a[:, i] for i, name in enumerate(BASE_ACCELERATION)}
    for prefix, values in (
        ("q", motion.joint_positions()),
        ("v", motion.joint_velocities()),
        ("a", motion.joint_accelerations()),
    ):
        columns |= {f"{prefix}.{joint}": values[:, i] for i, joint in enumerate(motion.joint_names)}
    columns |= {f"contact.{foot}": flags.astype(np.int64) for foot, flags in motion.contacts.items()}
    return columns


def unit_quaternions(quaternions: Array) -> Array:
    """Quaternions ``(n, 4)`` of length one; those that are so to nine digits as they are."""
    norm = np.linalg.norm(quaternions, axis=1)
    return np.where(np.abs(norm - 1.0)[:, None] > _UNIT, quaternions / norm[:, None], quaternions)


def content_hash(columns: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 of columns as they are after reading, whatever the order in which a file holds them, hexadecimal."""
    pose = [name for name in BASE_POSE[3:] if name in columns]
    if pose:
        unit = unit_quaternions(np.column_stack([np.asarray(columns[name], dtype=float) for name in pose]))
        columns = {**columns, **{name: unit[:, i] for i, name in enumerate(pose)}}
    digest = hashlib.sha256()
    for name in sorted(columns):
        # Adding zero makes one zero of the two.
        values = np.ascontiguousarray(np.asarray(columns[name], dtype="<f8") + 0.0)
        digest.update(f"{name}\0{len(values)}\0".encode() + values.tobytes())
    return digest.hexdigest()


def with_verdict(motion: Motion, verdict: Mapping[str, Any], robot_hash: str) -> Motion:
    """The motion with a verdict that says which robot and which samples it belongs to.

    Args:
        motion: the motion that was judged.
        verdict: its entry in an ``excite.check/1`` document.
        robot_hash: hash of the robot that it was judged for.
    """
    sealed = {**verdict, "robot_hash": robot_hash, "content_hash": content_hash(motion_columns(motion))}
    return replace(motion, metadata=replace(motion.metadata, verdict=sealed))
