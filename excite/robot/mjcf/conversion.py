"""From a MuJoCo model file (MJCF) to a URDF: what can be said in one is, what cannot is refused by name."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from excite.atomic import write_bytes, write_text
from excite.errors import InputError, RobotError
from excite.finding import first_names
from excite.formats.child import in_child
from excite.formats.documents import read_xml
from excite.robot.mjcf.scan import scan_mjcf
from excite.robot.mjcf.trees import BlockWriter, driven_joints, find_mimics, read_closures, robot_root
from excite.robot.mjcf.urdf import UrdfWriter
from excite.robot.refusal import robot_error
from excite.robot.urdf.limits import symmetric

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
        raise robot_error(path, None, f"MuJoCo cannot compile it ({line})", "mend it there") from error
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
            raise robot_error(
                path,
                f"mesh {geom.meshname!r}",
                f"mesh file {missing[geom.meshname].file!r} is not there, and the inertia of body"
                f" {geom.parent.name!r} follows from it",
                "put the file there or give the body an <inertial>",
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
            raise robot_error(
                path,
                f"joint {model.joint(joint).name!r}",
                "is a ball joint; only joints with one coordinate are modelled",
                "make it three hinges",
            )
    for tendon in range(model.ntendon):
        first = int(model.tendon_adr[tendon])
        if model.wrap_type[first] != mujoco.mjtWrap.mjWRAP_JOINT:
            raise robot_error(
                path,
                f"tendon {model.tendon(tendon).name!r}",
                "is a tendon along a path in space, no linear map of joints",
                "remove it and what it drives, or make it a fixed tendon",
            )
    if model.nflex:
        raise robot_error(path, "flex", "is deformable", "remove it")


def _check_angles(model: mujoco.MjModel, path: Path) -> None:
    """Refuse ranges in radians that MuJoCo took for degrees: then no hinge turns by more than a turn's 57th part."""
    import mujoco

    hinges = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) & (model.jnt_limited != 0)
    widest = float(np.abs(model.jnt_range[hinges]).max(initial=0.0))
    if hinges.sum() > 1 and 0.0 < widest <= np.radians(2.0 * np.pi):
        raise robot_error(
            path,
            "compiler",
            f"no hinge turns further than {np.degrees(widest):.1f} degrees: ranges look like radians",
            'write <compiler angle="radian"/>',
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


# What a MuJoCo model says of rest: its keyframe, bodies that may touch, joints that tendons drive.

# A joint that neither its motor nor the weight of all it carries, a metre away from a hinge, moves faster than this
# on the earth cannot be made to move [m/s or rad/s, m/s²]. Dampings of joints that move end at 1e3; some of gymnasium's
# Fetch are locked by 1e7 and 1e11. What a wrist carries may weigh nothing in a model: a hand that is yet to be added.
_SLOWEST, _GRAVITY = 1e-3, 9.81

_NAMES = ("home", "stand", "standing", "init", "rest")


def rest_keyframe(model: mujoco.MjModel, joint_name: Callable[[int], str]) -> dict[str, float] | None:
    """Joint values, from their references, of the keyframe named like a rest; None without such a one."""
    names = [model.key(number).name.lower() for number in range(model.nkey)]
    found = [number for name in _NAMES for number, called in enumerate(names) if called == name]
    if not found:
        return None
    q = np.asarray(model.key_qpos[found[0]])
    values = {}
    for joint in _single_joints(model):
        address = int(model.jnt_qposadr[joint])
        values[joint_name(joint)] = float(q[address] - model.qpos0[address])
    return values


def damped_joints(model: mujoco.MjModel) -> set[int]:
    """Hinges and slides whose damping lets nothing move them."""
    force = _GRAVITY * model.body_subtreemass[model.jnt_bodyid]
    for joint, torque in torque_limits(model).items():
        force[joint] = max(force[joint], torque)
    damping = model.dof_damping[model.jnt_dofadr]
    return {joint for joint in _single_joints(model) if damping[joint] * _SLOWEST > force[joint]}


def _single_joints(model: mujoco.MjModel) -> list[int]:
    """Hinges and slides."""
    import mujoco

    # As integers: MuJoCo's enumerations are unequal to NumPy's, though not the other way round.
    kinds = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
    return [joint for joint in range(model.njnt) if int(model.jnt_type[joint]) in kinds]


def excluded_pairs(
    model: mujoco.MjModel, bodies: tuple[int, ...], link_name: Callable[[int], str]
) -> tuple[tuple[str, str], ...]:
    """Pairs of links whose contacts the model excludes."""
    pairs = []
    for signature in model.exclude_signature:
        first, second = int(signature) >> 16, int(signature) & 0xFFFF
        if first in bodies and second in bodies:
            pairs.append((link_name(first), link_name(second)))
    return tuple(pairs)


def tendon_groups(model: mujoco.MjModel) -> list[set[int]]:
    """Joints that an actuator drives through a tendon, together with others, actuator by actuator."""
    import mujoco

    groups = []
    for actuator in range(model.nu):
        if model.actuator_trntype[actuator] != mujoco.mjtTrn.mjTRN_TENDON:
            continue
        tendon = int(model.actuator_trnid[actuator, 0])
        first = int(model.tendon_adr[tendon])
        joints = model.wrap_objid[first : first + int(model.tendon_num[tendon])]
        groups.append({int(joint) for joint in joints})
    return groups


# Which joints of a MuJoCo model its motors drive, with what largest torque, and within what commands.


def torque_limits(model: mujoco.MjModel) -> dict[int, float]:
    """Largest torque of each joint: its own force range, or its motor's where that is less, the same either way."""
    import mujoco

    limits: dict[int, float] = {}
    for joint in range(model.njnt):
        if model.jnt_actfrclimited[joint]:
            limits[joint] = symmetric(*model.jnt_actfrcrange[joint])
    for actuator in range(model.nu):
        joint = int(model.actuator_trnid[actuator, 0])
        on_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
        if not on_joint:
            continue
        gear = abs(float(model.actuator_gear[actuator, 0]))
        plain = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
        if model.actuator_forcelimited[actuator]:
            most = gear * symmetric(*model.actuator_forcerange[actuator])
        elif plain and model.actuator_ctrllimited[actuator]:
            gain = abs(float(model.actuator_gainprm[actuator, 0]))
            most = gear * gain * symmetric(*model.actuator_ctrlrange[actuator])
        else:
            continue
        limits[joint] = min(most, limits.get(joint, math.inf))
    return limits


def narrow_to_commands(model: mujoco.MjModel) -> list[int]:
    """Narrow joints' ranges to what their position servos may be told, and name those that this changed.

    A servo of gear one whose force is ``kp (ctrl - q)`` is told a position, and MuJoCo keeps that in ``ctrlrange``.
    """
    import mujoco

    changed = []
    for actuator in range(model.nu):
        joint = int(model.actuator_trnid[actuator, 0])
        gain, bias = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator]
        servo = (
            model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
            and model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE
            and gain > 0.0
            and np.isclose(bias[1], -gain)
            and model.actuator_gear[actuator, 0] == 1.0
            and model.actuator_ctrllimited[actuator]
        )
        if not servo:
            continue
        low, high = model.actuator_ctrlrange[actuator]
        if model.jnt_limited[joint]:
            stated = model.jnt_range[joint]
            low, high = max(low, stated[0]), min(high, stated[1])
            if low >= high or (low == stated[0] and high == stated[1]):
                continue
        model.jnt_limited[joint], model.jnt_range[joint] = 1, (low, high)
        changed.append(joint)
    return changed


def idle_balls(model: mujoco.MjModel) -> set[int]:
    """Ball joints that no motor turns, such as a caster's; none of a model without motors, which does not tell."""
    import mujoco

    on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    on_joint |= model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINTINPARENT
    driven = {int(joint) for joint in model.actuator_trnid[on_joint, 0]}
    balls = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_BALL)
    return {int(joint) for joint in balls if int(joint) not in driven} if driven else set()


def idle_joints(model: mujoco.MjModel, bodies: Collection[int], known: Collection[int]) -> set[int]:
    """Hinges and slides of ``bodies`` that no motor drives, such as an acrobot's shoulder: no command moves them.

    None of a model without motors, which does not tell, or with motors that act on sites or bodies, which may move any.

    Args:
        model: the model.
        bodies: the robot's bodies.
        known: joints that a motor drives, or that an equality ties to others or to a value.
    """
    import mujoco

    on = mujoco.mjtTrn
    told = np.isin(model.actuator_trntype, [on.mjTRN_JOINT, on.mjTRN_JOINTINPARENT, on.mjTRN_TENDON])
    if not model.nu or not told.all():
        return set()
    one = np.isin(model.jnt_type, [mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE])
    return {int(joint) for joint in np.flatnonzero(one) if model.jnt_bodyid[joint] in bodies} - set(known)


# Rotor inertias that a MuJoCo model states, which a URDF cannot.


def rotor_inertias(model: mujoco.MjModel, joint_name: Callable[[int], str]) -> dict[str, float]:
    """``armature`` of the hinges and slides that have one, by name [kg·m² or kg]."""
    return {
        joint_name(joint): float(model.dof_armature[model.jnt_dofadr[joint]])
        for joint in _single_joints(model)
        if model.dof_armature[model.jnt_dofadr[joint]] > 0.0
    }
