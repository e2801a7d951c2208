"""NumPy archives: one matrix a quantity."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from excite.atomic import atomic_path
from excite.export.exporter import Exporter
from excite.motion.motion import Motion


class NpzExporter(Exporter):
    """Arrays ``time`` (n,), ``q``, ``v``, ``a`` (n, n_joints) [SI] and ``joint_names``; no pickled objects.

    A free base adds ``base_pose`` (n, 7: x y z qx qy qz qw, world frame), ``base_twist`` and
    ``base_acceleration`` (n, 6: linear, angular, base frame); feet add ``contact.FOOT`` (n,) booleans. ``robot``,
    ``robot_hash`` and ``verdict`` (JSON) say whose it is and what the independent check said of it.
    """

    name = "npz"
    suffix = ".npz"
    summary = "NumPy archive with matrices time, q, v, a and joint_names"

    def write(self, motion: Motion, path: Path) -> None:
        """See :class:`Exporter`."""
        arrays: dict[str, Any] = {
            "time": motion.time,
            "joint_names": np.array(motion.joint_names),
            "q": motion.joint_positions(),
            "v": motion.joint_velocities(),
            "a": motion.joint_accelerations(),
        }
        if motion.floating:
            arrays |= {
                "base_pose": motion.q[:, :7],
                "base_twist": motion.v[:, :6],
                "base_acceleration": motion.a[:, :6],
            }
        metadata = motion.metadata
        arrays |= {"robot": np.array(motion.robot), "robot_hash": np.array(metadata.robot_hash)}
        if metadata.verdict is not None:
            arrays["verdict"] = np.array(json.dumps(metadata.verdict))
        arrays |= {f"contact.{foot}": flags for foot, flags in motion.contacts.items()}
        with atomic_path(path) as temporary:
            np.savez_compressed(temporary, **arrays)
