"""From a MuJoCo model file (MJCF) to a URDF: what can be said in one is, what cannot is refused by name."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from excite.atomic import write_bytes, write_text
from excite.errors import InputError, RobotError
from excite.finding import first_names
from excite.reading.child import in_child
from excite.reading.xml_document import read_xml
from excite.robot.mjcf.closure_blocks import BlockWriter
from excite.robot.mjcf.closures import driven_joints, find_mimics, read_closures
from excite.robot.mjcf.resting import damped_joints, excluded_pairs, rest_keyframe, tendon_groups
from excite.robot.mjcf.rotors import rotor_inertias
from excite.robot.mjcf.scan import scan_mjcf
from excite.robot.mjcf.torques import idle_balls, idle_joints, narrow_to_commands, torque_limits
from excite.robot.mjcf.trees import robot_root
from excite.robot.mjcf.urdf import UrdfWriter

if TYPE_CHECKING:
    import mujoco

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
        "excite.robot.mjcf.conversion:compile_mjcf",
        path,
        source=path,
        error=RobotError,
        seconds=COMPILE_SECONDS,
        memory_gb=COMPILE_MEMORY_GB,
    )
    return conversion


def compile_mjcf(path: Path) -> MjcfConversion:
    """As :func:`convert_mjcf`, in this process and without looking through the file first."""
    import mujoco

    # MuJoCo writes warnings to a file in the current folder.
    mujoco.set_mju_user_warning(lambda _: None)
    notes: list[str] = []
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        _strip_missing_meshes(spec, path, notes)
        model = spec.compile()
    except (ValueError, OSError, RuntimeError) as error:
        line = " ".join(str(error).split())
        raise RobotError(f"MuJoCo cannot compile it ({line})", source=path, remedy="mend it there") from error
    idle = idle_balls(model)
    if idle:
        names = ", ".join(model.joint(joint).name or f"joint_{joint}" for joint in sorted(idle)[:6])
        notes.append(f"ball joints that no motor turns are held still ({names})")
    _refuse_unsupported(model, idle, path)
    _check_angles(model, path)
    root, objects = robot_root(model, path)
    bodies = tuple(
        body
        for body in range(1, model.nbody)
        if (model.body_rootid[body] == root if root else model.body_rootid[body] not in objects)
    )
    if objects:
        names = ", ".join(repr(model.body(body).name) for body in objects[:6])
        notes.append(f"bodies that move on their own are no part of the robot and left out ({names})")
    narrowed = narrow_to_commands(model)
    if narrowed:
        names = first_names([model.joint(joint).name or f"joint_{joint}" for joint in narrowed])
        notes.append(f"ranges end where the commands of position servos do ({names})")
    closures = read_closures(model, path)
    if closures.handles:
        notes.append("equalities with mocap bodies, handles of a simulation, are left out")
    for why, joints in closures.held.items():
        _hold_joints(model, joints, why, notes)
    for joint, value in closures.still.items():
        model.jnt_limited[joint] = 1
        model.jnt_range[joint] = value + model.qpos0[model.jnt_qposadr[joint]]
    known = driven_joints(model).union(*closures.passive.values(), *closures.held.values())
    idle_ones = idle_joints(model, bodies, known.union(closures.still))
    # What one motor drives through a tendon is one freedom where equalities tie it together.
    many = {joint for group in tendon_groups(model) if group - known for joint in group}
    _hold_joints(model, many, "joints that one motor drives together through a tendon", notes)
    _hold_joints(model, idle_ones - many, "joints that no motor drives", notes)
    _hold_joints(model, damped_joints(model), "joints whose damping lets nothing move them", notes)
    writer = UrdfWriter(model, bodies, find_mimics(model, closures), torque_limits(model))
    robot = writer.robot(spec.modelname or path.stem, root)
    blocks = BlockWriter(model, closures, writer.joint_name, writer.link_name, writer.anchors)
    if model.jnt_stiffness.any():
        notes.append("springs of joints (stiffness) are left out: torques predicted there lack them")
    text = '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"
    return MjcfConversion(
        spec.modelname or path.stem,
        root != 0,
        text,
        writer.meshes,
        (*notes, *writer.notes),
        rest_keyframe(model, writer.joint_name),
        excluded_pairs(model, bodies, writer.link_name),
        blocks.loops(),
        blocks.couplings(),
        rotor_inertias(model, writer.joint_name),
    )


def _strip_missing_meshes(spec: mujoco.MjSpec, path: Path, notes: list[str]) -> None:
    """Take geoms out whose mesh file is not there, where no inertia depends on them."""
    folder = path.parent / (spec.meshdir or "")
    missing = {
        mesh.name: mesh for mesh in spec.meshes if mesh.file and not os.path.isfile(folder / mesh.file)
    }
    if not missing:
        return
    for geom in list(spec.geoms):
        if geom.meshname not in missing:
            continue
        if geom.parent.name != "world" and not geom.parent.explicitinertial:
            raise RobotError(
                f"mesh file {missing[geom.meshname].file!r} is not there, and the inertia of body"
                f" {geom.parent.name!r} follows from it",
                source=path,
                field=f"mesh {geom.meshname!r}",
                remedy="put the file there or give the body an <inertial>",
            )
        spec.delete(geom)
    for mesh in missing.values():
        spec.delete(mesh)
    names = ", ".join(sorted(missing)[:4]) + (", …" if len(missing) > 4 else "")
    notes.append(f"{len(missing)} mesh files are not there and left out ({names})")


def _refuse_unsupported(model: mujoco.MjModel, idle: set[int], path: Path) -> None:
    """Refuse what is not a tree of one-coordinate joints, but for balls that are held still."""
    import mujoco

    for joint in range(model.njnt):
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_BALL and joint not in idle:
            raise RobotError(
                "is a ball joint; only joints with one coordinate are modelled",
                source=path,
                field=f"joint {model.joint(joint).name!r}",
                remedy="make it three hinges",
            )
    for tendon in range(model.ntendon):
        first = int(model.tendon_adr[tendon])
        if model.wrap_type[first] != mujoco.mjtWrap.mjWRAP_JOINT:
            raise RobotError(
                "is a tendon along a path in space, no linear map of joints",
                source=path,
                field=f"tendon {model.tendon(tendon).name!r}",
                remedy="remove it and what it drives, or make it a fixed tendon",
            )
    if model.nflex:
        raise RobotError("is deformable", source=path, field="flex", remedy="remove it")


def _check_angles(model: mujoco.MjModel, path: Path) -> None:
    """Refuse ranges in radians that MuJoCo took for degrees: then no hinge turns by more than a turn's 57th part."""
    import mujoco

    hinges = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) & (model.jnt_limited != 0)
    widest = float(np.abs(model.jnt_range[hinges]).max(initial=0.0))
    if hinges.sum() > 1 and 0.0 < widest <= np.radians(2.0 * np.pi):
        raise RobotError(
            f"no hinge turns further than {np.degrees(widest):.1f} degrees: ranges look like radians",
            source=path,
            field="compiler",
            remedy='write <compiler angle="radian"/>',
        )


def _hold_joints(model: mujoco.MjModel, joints: set[int], which: str, notes: list[str]) -> None:
    """Leave joints no range, so that a first description holds them still, and say so."""
    if not joints:
        return
    held = sorted(joints)
    for joint in held:
        model.jnt_limited[joint], model.jnt_range[joint] = 1, model.qpos0[model.jnt_qposadr[joint]]
    names = ", ".join(model.joint(joint).name or f"joint_{joint}" for joint in held[:6])
    notes.append(f"{which} are held still ({names}{', …' if len(held) > 6 else ''})")
