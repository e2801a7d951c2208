"""A model in another format as a URDF, and what else its file says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from excite.atomic import write_bytes, write_text


@dataclass(frozen=True, eq=False)
class ConvertedModel:
    """A model of MuJoCo, SDF or USD as a URDF.

    Attributes:
        name: of the model.
        floating: whether its base is free, None where the file does not say.
        urdf: the URDF's text; mesh paths are relative to its file.
        meshes: STL files by relative path.
        notes: what the URDF leaves out or says differently.
        posture: joints of the keyframe in which the robot rests [rad or m], None without one.
        excluded: pairs of links that the model lets touch.
        loops: blocks ``loops`` of a ``robot.yaml``, which a URDF does not have.
        couplings: blocks ``couplings`` of one.
        armature: rotor inertia by joint, where there is one [kg·m² or kg].
    """

    name: str
    floating: bool | None
    urdf: str
    meshes: Mapping[str, bytes] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    posture: Mapping[str, float] | None = None
    excluded: tuple[tuple[str, str], ...] = ()
    loops: tuple[Mapping[str, Any], ...] = ()
    couplings: tuple[Mapping[str, Any], ...] = ()
    armature: Mapping[str, float] = field(default_factory=dict)

    def write(self, path: Path) -> Path:
        """Write the URDF to ``path`` and the meshes beside it."""
        for name, content in self.meshes.items():
            write_bytes(path.parent / name, content)
        return write_text(path, self.urdf)
