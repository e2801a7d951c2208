"""From a MuJoCo model file (MJCF) to a URDF: what can be said in one is, what cannot is refused by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from excite.atomic import write_bytes, write_text
from excite.errors import InputError, RobotError
from excite.formats.child import in_child
from excite.formats.documents import read_xml
from excite.robot.mjcf.scan import scan_mjcf

# The largest model known, a humanoid with hands and 60 meshes, takes 3 s and 0.6 GB.
COMPILE_SECONDS = 40.0
COMPILE_MEMORY_GB = 8.0


@dataclass(frozen=True, eq=False)
class MjcfConversion:
    """A MuJoCo model as a URDF.

    Attributes:
        name: of the model.
        floating: whether its base has a free joint.
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
    floating: bool
    urdf: str
    meshes: Mapping[str, bytes]
    notes: tuple[str, ...]
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


def is_mjcf(path: Path) -> bool:
    """Whether a file is a MuJoCo model: XML whose outermost element is ``mujoco``; False if it cannot be read."""
    try:
        return read_xml(path).tag == "mujoco"
    except InputError:
        return False


def convert_mjcf(path: Path) -> MjcfConversion:
    """Read a MuJoCo model and write it as a URDF.

    The model is compiled by MuJoCo, in a process of its own, so defaults, includes, orientations of every kind
    and inertias that follow from geometry are as MuJoCo understands them. Bodies, hinges and slides, inertials,
    primitive solids and meshes are carried over; a joint coupled to another by a linear equality becomes a mimic
    joint, and other equalities loops and couplings of a ``robot.yaml``, where their joints without a motor follow
    from those with one; else these are held still, as are all joints that no motor drives where others have one.

    Args:
        path: the MJCF file.

    Returns:
        The conversion.

    Raises:
        RobotError: MuJoCo cannot compile it, or it holds what no tree of hinges and slides can say: ball
            joints, several robots of which one floats, tendons along paths in space, deformable bodies,
            or a mesh that is not there although a body's inertia depends on it; or it is too large, or makes
            MuJoCo crash, hang or take all memory.
    """
    path = Path(path)
    scan_mjcf(path)
    conversion: MjcfConversion = in_child(
        "excite.robot.mjcf.compiled:compile_mjcf",
        path,
        source=path,
        error=RobotError,
        seconds=COMPILE_SECONDS,
        memory_gb=COMPILE_MEMORY_GB,
    )
    return conversion
