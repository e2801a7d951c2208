"""What is known of a model file that was written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class WrittenModel:
    """A model file with identified inertials, and the proof that simulators read it so.

    Attributes:
        path: the file.
        changed: links (or bodies) whose inertial was changed.
        notes: what a user of the file should know, one sentence each.
        pinocchio_error: largest difference between inverse dynamics of the file read by pinocchio and the
            identified parameters' regression, relative to the largest torque; None where not checked.
        mujoco_error: the same for the file read by MuJoCo.
    """

    path: Path
    changed: tuple[str, ...]
    notes: tuple[str, ...]
    pinocchio_error: float | None
    mujoco_error: float | None

    def to_json(self) -> dict[str, Any]:
        """The file's entry in a JSON document."""
        return {
            "file": self.path.name,
            "changed": list(self.changed),
            "notes": list(self.notes),
            "pinocchio_error": self.pinocchio_error,
            "mujoco_error": self.mujoco_error,
        }
