"""A MuJoCo model compiled, and what a URDF and a ``robot.yaml`` say of it; loaded in a process of its own."""

from __future__ import annotations

import os
from pathlib import Path
from xml.etree.ElementTree import tostring

import mujoco
import numpy as np

from excite.errors import in_one_line
from excite.finding import first_names
from excite.robot.mjcf.trees import (
    Closures,
    driven_joints,
    find_mimics,
    idle_joints,
    narrow_to_commands,
    read_closures,
    robot_root,
    single_joints,
    tendon_groups,
    torque_limits,
    write_ties,
)
from excite.robot.mjcf.urdf import BALL, HINGE, UrdfWriter
from excite.robot.refusal import robot_error
from excite.robot.urdf.converted import ConvertedModel


def compile_mjcf(path: Path) -> ConvertedModel:
    """As :func:`~excite.robot.mjcf.conversion.convert_mjcf`, in this process, without looking through the file."""
    # MuJoCo writes warnings to a file in the current folder.
    mujoco.set_mju_user_warning(lambda _: None)
    notes: list[str] = []
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        _strip_missing_meshes(spec, path, notes)
        model = spec.compile()
    except (ValueError, OSError, RuntimeError) as error:
        raise robot_error(
            path, None, f"MuJoCo cannot compile it ({in_one_line(error)})", "mend it there"
        ) from error
    writer = UrdfWriter(model)
    balls = idle_joints(model, {BALL})
    if balls:
        notes.append(f"ball joints that no motor turns are held still ({_name_joints(writer, balls)})")
    _refuse_unsupported(model, balls, path)
    root, objects = robot_root(model, path)
    roots = model.body_rootid[1:]
    own = roots == root if root else ~np.isin(roots, objects)
    bodies = (1 + np.flatnonzero(own)).tolist()
    if objects:
        names = ", ".join(repr(model.body(body).name) for body in objects[:6])
        notes.append(f"bodies that move on their own are no part of the robot and left out ({names})")
    narrowed = narrow_to_commands(model)
    if narrowed:
        names = first_names([writer.joint_name(joint) for joint in narrowed])
        notes.append(f"ranges end where the commands of position servos do ({names})")
    closures = read_closures(model, path)
    if closures.handles:
        notes.append("equalities with mocap bodies, handles of a simulation, are left out")
    _hold_joints(model, closures, set(bodies), writer, notes)
    writer.mimics, writer.torque_limits = find_mimics(model, closures), torque_limits(model)
    robot = writer.write_robot(spec.modelname or path.stem, root, bodies)
    if model.jnt_stiffness.any():
        notes.append("springs of joints (stiffness) are left out: torques predicted there lack them")
    ties = write_ties(model, closures, writer)
    pairs = [(int(pair) >> 16, int(pair) & 0xFFFF) for pair in model.exclude_signature]
    known = [pair for pair in pairs if set(pair) <= set(bodies)]
    rotors = {joint: float(model.dof_armature[model.jnt_dofadr[joint]]) for joint in single_joints(model)}
    return ConvertedModel(
        floating=root != 0,
        urdf='<?xml version="1.0"?>\n' + tostring(robot, encoding="unicode") + "\n",
        meshes=writer.meshes,
        notes=(*notes, *writer.notes),
        posture=_rest_keyframe(model, writer),
        ignored=tuple((writer.link_name(first), writer.link_name(second)) for first, second in known),
        loops=tuple(ties.loops),
        couplings=tuple(ties.couplings),
        armature={writer.joint_name(joint): rotor for joint, rotor in rotors.items() if rotor > 0.0},
    )


def _hold_joints(
    model: mujoco.MjModel, closures: Closures, bodies: set[int], writer: UrdfWriter, notes: list[str]
) -> None:
    """Leave joints of ``bodies`` no range that nothing moves, so that a first description holds them still."""
    for joint, value in closures.still.items():
        model.jnt_limited[joint] = 1
        model.jnt_range[joint] = value + model.qpos0[model.jnt_qposadr[joint]]
    for why, joints in (*closures.held.items(), *_unmoved_joints(model, closures, bodies).items()):
        # Without a range, a first description holds them still.
        for joint in joints:
            model.jnt_limited[joint], model.jnt_range[joint] = 1, model.qpos0[model.jnt_qposadr[joint]]
        if joints:
            notes.append(
                f"{why} are held still ({_name_joints(writer, joints)}{', …' if len(joints) > 6 else ''})"
            )


def _name_joints(writer: UrdfWriter, joints: set[int]) -> str:
    return ", ".join(writer.joint_name(joint) for joint in sorted(joints)[:6])


def _unmoved_joints(model: mujoco.MjModel, closures: Closures, bodies: set[int]) -> dict[str, set[int]]:
    """Joints of ``bodies`` that nothing moves on its own, by why not."""
    known = driven_joints(model).union(*closures.passive.values(), *closures.held.values(), closures.still)
    idle = {joint for joint in idle_joints(model) - known if int(model.jnt_bodyid[joint]) in bodies}
    # What one motor drives through a tendon is one freedom where equalities tie it together.
    many = {joint for group in tendon_groups(model) if group - known for joint in group}
    # A joint that neither its motor nor the weight of all it carries, a metre away from a hinge, moves faster than this
    # on the earth cannot be made to move [m/s or rad/s, m/s²]. Dampings of joints that move end at 1e3; some of
    # gymnasium's Fetch are locked by 1e7 and 1e11. What a wrist carries may weigh nothing in a model: a hand that is
    # yet to be added.
    force = 9.81 * model.body_subtreemass[model.jnt_bodyid]
    for joint, torque in torque_limits(model).items():
        force[joint] = max(force[joint], torque)
    stuck = model.dof_damping[model.jnt_dofadr] * 1e-3 > force
    return {
        "joints that one motor drives together through a tendon": many,
        "joints that no motor drives": idle - many,
        "joints whose damping lets nothing move them": {j for j in single_joints(model) if stuck[j]},
    }


def _strip_missing_meshes(spec: mujoco.MjSpec, path: Path, notes: list[str]) -> None:
    """Take geoms out whose mesh file is not there, where no inertia depends on them."""
    folder = path.parent / (spec.meshdir or "")
    missing = {
        mesh.name: mesh for mesh in spec.meshes if mesh.file and not os.path.isfile(folder / mesh.file)
    }
    for geom in [geom for geom in spec.geoms if geom.meshname in missing]:
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
    if missing:
        names = first_names(sorted(missing), 4)
        notes.append(f"{len(missing)} mesh files are not there and left out ({names})")


def _refuse_unsupported(model: mujoco.MjModel, idle: set[int], path: Path) -> None:
    """Refuse what is not a tree of one-coordinate joints, but for balls that are held still, and angles by mistake."""
    for joint in set(np.flatnonzero(model.jnt_type == BALL).tolist()) - idle:
        what = "is a ball joint; only joints with one coordinate are modelled"
        raise robot_error(path, f"joint {model.joint(joint).name!r}", what, "make it three hinges")
    for tendon in range(model.ntendon):
        if model.wrap_type[model.tendon_adr[tendon]] != mujoco.mjtWrap.mjWRAP_JOINT:
            what = "is a tendon along a path in space, no linear map of joints"
            remedy = "remove it and what it drives, or make it a fixed tendon"
            raise robot_error(path, f"tendon {model.tendon(tendon).name!r}", what, remedy)
    if model.nflex:
        raise robot_error(path, "flex", "is deformable", "remove it")
    # Ranges in radians that MuJoCo took for degrees: then no hinge turns by more than a turn's 57th part.
    hinges = (model.jnt_type == HINGE) & (model.jnt_limited != 0)
    widest = float(np.degrees(np.abs(model.jnt_range[hinges]).max(initial=0.0)))
    if hinges.sum() > 1 and 0.0 < widest <= 2.0 * np.pi:
        what = f"no hinge turns further than {widest:.1f} degrees: ranges look like radians"
        raise robot_error(path, "compiler", what, 'write <compiler angle="radian"/>')


def _rest_keyframe(model: mujoco.MjModel, writer: UrdfWriter) -> dict[str, float] | None:
    """Joint values, from their references, of the keyframe named like a rest; None without such a one."""
    names = [model.key(number).name.lower() for number in range(model.nkey)]
    # Key frames in which a robot rests.
    found = next(
        (names.index(name) for name in ("home", "stand", "standing", "init", "rest") if name in names), None
    )
    if found is None:
        return None
    off = model.key_qpos[found] - model.qpos0
    return {writer.joint_name(j): float(off[model.jnt_qposadr[j]]) for j in single_joints(model)}
