"""A model in another format as a URDF, and what else its file says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from excite.atomic import write_bytes, write_text
from excite.results import Assumed
from excite.robot.description import PositionTable


@dataclass(frozen=True, kw_only=True, eq=False)
class Said:
    """What a model's file says that a URDF cannot.

    Attributes:
        floating: whether the base is free, None where the file does not say.
        posture: joint values of a keyframe at which the robot rests [rad or m], None without one.
        ignored: pairs of links that may touch.
        loops: blocks ``loops`` of a ``robot.yaml``.
        couplings: blocks ``couplings`` of one.
        assumed: what was assumed to make the URDF.
        armature: rotor inertia by joint, where there is one [kg·m² or kg].
        by_position: limits that depend on positions.
        uncertainty: block ``uncertainty`` of an arm whose masses were assumed.
    """

    floating: bool | None = None
    posture: Mapping[str, float] | None = None
    ignored: tuple[tuple[str, str], ...] = ()
    loops: tuple[Mapping[str, Any], ...] = ()
    couplings: tuple[Mapping[str, Any], ...] = ()
    assumed: tuple[Assumed, ...] = ()
    armature: Mapping[str, float] = field(default_factory=dict)
    by_position: tuple[PositionTable, ...] = ()
    uncertainty: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class ConvertedModel(Said):
    """A URDF that was made of a file, and what that says besides.

    Attributes:
        urdf: its text, mesh paths relative to its file; None where the file itself is the URDF.
        meshes: STL files by relative path.
        notes: what the file says and the URDF leaves out or says differently.
    """

    urdf: str | None = None
    meshes: Mapping[str, bytes] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def write(self, path: Path) -> Path:
        """Write the URDF to ``path`` and the meshes beside it."""
        for name, content in self.meshes.items():
            write_bytes(path.parent / name, content)
        return write_text(path, self.urdf or "")
