"""A MuJoCo model with identified inertials: a given MJCF text with other numbers, or one made here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from excite.atomic import atomic_path
from excite.errors import InputError, NoSolutionError
from excite.export.models.bodies import Member, changed_segments, moved_pseudo, split_segment
from excite.export.models.urdf import TOLERANCE
from excite.export.models.verification import (
    MujocoNames,
    held_joints,
    mujoco_error,
    mujoco_places,
    random_states,
    robot_names,
)
from excite.export.models.written import WrittenModel
from excite.export.models.xml_text import Element, XmlText, number_text
from excite.identification.inertia import pseudo_inertia_matrices
from excite.identification.result import Identification
from excite.robot.loading import model_file
from excite.robot.robot import Array, Robot
from excite.robot.urdf import parse_urdf
from excite.simulation.drives import Drives, nominal_drives
from excite.simulation.inertial import principal_inertia
from excite.simulation.mjcf import World, build_spec

if TYPE_CHECKING:
    import mujoco

# How far apart frames of one body may lie in the file and in the robot from one posture to another [m, rad].
_SAME_FRAME = 1e-4
# Bodies of a template that are nearer to the identified parameters, relatively, are left alone.
_SAME_INERTIA = 1e-4
_ORIENTATIONS = ("quat", "euler", "axisangle", "xyaxes", "zaxis")


def write_mjcf(
    robot: Robot,
    identification: Identification,
    path: Path,
    *,
    template: Path | None = None,
    names: Mapping[str, str] | None = None,
    drives: bool = False,
) -> WrittenModel:
    """Write a MuJoCo model with the identified inertials.

    With a template its text is edited: only inertials change (one is added where the template leaves them to
    its geometry). Without one the model is what :func:`~excite.simulation.mjcf.build_spec` makes of the
    robot, all digits written. What MuJoCo then computes has to agree with the identified parameters.

    Args:
        robot: the robot that was identified.
        identification: what was identified.
        path: file to write; mesh paths of a template stay relative to it.
        template: an MJCF file of the same robot.
        names: names of links and joints in the template, where they are not the robot's.
        drives: also write viscous and Coulomb friction and rotor inertia that were identified.

    Returns:
        The file and what was checked.

    Raises:
        InconsistentModelError: a segment is no rigid body; MuJoCo refuses such models.
        InputError: the identification is of another robot, or the template is another robot's.
        NoSolutionError: MuJoCo does not give the identified parameters' torques (a bug here).
    """
    changed = changed_segments(robot, identification, force=False)
    ten = identification.parameters.reshape(-1, 10)
    friction = _identified_drives(robot, identification) if drives else nominal_drives(robot)
    if template is None:
        content = exact_text(build_spec(robot, identification.parameters, friction, World()))
        links = tuple(robot.segments[k].link for k in changed)
        model, names_here = _compiled(content, None), _names(robot, {})
        error = mujoco_error(robot, model, names_here, identification.parameters)
        return _write(content, WrittenModel(Path(path), links, (), None, error))
    names = names or {}
    nominal = _compiled(template.read_bytes(), template)
    members = _members(robot, nominal, _names(robot, names), names)
    text = XmlText(template.read_bytes(), template)
    bodies = {str(body.attributes.get("name")): body for body in text.root.everywhere("body")}
    notes, written = [], []
    other = [k for k in range(len(ten)) if _difference(members[k], ten[k]) > _SAME_INERTIA]
    for segment in sorted({*changed, *other}):
        split = split_segment(ten[segment], members[segment])
        notes += [split.note] if split.note else []
        for body, parameters in split.shares.items():
            if body not in bodies:
                raise InputError(
                    f"has no <body name={body!r}> in its own text",
                    source=template,
                    remedy="give the file that describes the bodies, not one that includes it",
                )
            set_inertial(text, bodies[body], parameters, body)
            written.append(body)
    if drives:
        _set_drives(text, robot, friction, names)
    content = text.edited()
    if template.resolve().parent != Path(path).resolve().parent and list(text.root.everywhere("mesh")):
        notes.append(f"mesh paths are relative: put it beside {template.name}")
    model = _compiled(content, template)
    places = _names(robot, names)
    taken = _members(robot, model, places, names)
    error = max(_difference(taken[k], ten[k]) for k in sorted({*changed, *other}, key=int))
    in_motion = mujoco_error(robot, model, places, identification.parameters)
    if in_motion > TOLERANCE:
        notes.append(
            f"its torques are {in_motion:.1e} off the robot's: that is how far its geometry (or the inertia of "
            "bodies that were left alone) is from the URDF's"
        )
    return _write(content, WrittenModel(Path(path), tuple(written), tuple(notes), None, error))


def exact_text(spec: mujoco.MjSpec) -> bytes:
    """A specification as XML with all digits of its kinematics and inertials; MuJoCo writes six."""
    text = XmlText(spec.to_xml().encode("utf-8"), spec.modelname)
    for element in text.root.everywhere("body"):
        body = spec.body(str(element.attributes["name"]))
        text.set(element, pos=number_text(*body.pos), quat=number_text(*body.quat))
        joints = {joint.name: joint for joint in body.joints}
        for joint in element.named("joint"):
            found = joints[str(joint.attributes["name"])]
            text.set(joint, axis=number_text(*found.axis), range=number_text(*found.range))
        for inertial in element.named("inertial"):
            text.set(
                inertial,
                pos=number_text(*body.ipos),
                quat=number_text(*body.iquat),
                mass=number_text(body.mass),
                diaginertia=number_text(*body.inertia),
            )
    return text.edited()


def set_inertial(text: XmlText, body: Element, parameters: Array, name: str) -> None:
    """Give a body of an MJCF text ten parameters about its own frame; a missing inertial is added.

    Raises:
        UnphysicalParametersError: no rigid body has them.
    """
    if not parameters.any():
        return
    inertia = principal_inertia(parameters, name)
    values = {"pos": number_text(*inertia.com), "mass": number_text(inertia.mass)}
    x, y, z, w = pin.Quaternion(inertia.rotation).normalized().coeffs()
    diagonal = {"quat": number_text(w, x, y, z), "diaginertia": number_text(*inertia.moments)}
    found = body.named("inertial")
    if not found:
        attributes = " ".join(f'{key}="{value}"' for key, value in {**values, **diagonal}.items())
        text.insert_first(body, f"<inertial {attributes}/>")
        return
    if "fullinertia" in found[0].attributes:
        full = inertia.rotation @ np.diag(inertia.moments) @ inertia.rotation.T
        six = full[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        text.set(found[0], **values, fullinertia=number_text(*six))
        return
    for other in _ORIENTATIONS[1:]:
        text.remove_attribute(found[0], other)
    text.set(found[0], **values, **diagonal)


def _write(content: bytes, model: WrittenModel) -> WrittenModel:
    error = model.mujoco_error or 0.0
    if not error <= TOLERANCE:
        raise NoSolutionError(
            f"{model.path} was not written: what MuJoCo reads from it is off by {error:.1e}",
            remedy="report this with the model",
        )
    with atomic_path(model.path) as temporary:
        temporary.write_bytes(content)
    return model


def _names(robot: Robot, names: Mapping[str, str]) -> MujocoNames:
    return robot_names(robot, names, held_joints(robot, parse_urdf(model_file(robot))))


def _difference(members: list[Member], total: Array) -> float:
    """How far bodies together are from a segment's parameters, relative to the pseudo-inertia."""
    target = pseudo_inertia_matrices(total)[0]
    for member in members:
        if member.parameters is not None:
            target = target - moved_pseudo(pseudo_inertia_matrices(member.parameters)[0], member.placement)
    scale = float(np.abs(pseudo_inertia_matrices(total)).max())
    return float(np.abs(target).max()) / scale if scale else 0.0


def _compiled(content: bytes, template: Path | None) -> mujoco.MjModel:
    """Compile a text as if it stood where ``template`` stands."""
    import mujoco

    try:
        spec = mujoco.MjSpec.from_string(content.decode("utf-8"))
        if template is not None:
            _drop_missing_files(spec, template.resolve().parent)
        return spec.compile()
    except ValueError as error:
        raise InputError(
            f"MuJoCo refuses it ({' '.join(str(error).split())})",
            source=template or "written model",
            remedy="check that it loads in MuJoCo's viewer, with its meshes beside it",
        ) from error


def _drop_missing_files(spec: mujoco.MjSpec, folder: Path) -> None:
    """Make paths absolute, and leave out shapes whose files are not there: inertials are what counts here."""
    meshes = folder / spec.meshdir
    spec.meshdir, spec.texturedir = str(meshes), str(folder / spec.texturedir)
    missing = {mesh.name for mesh in spec.meshes if mesh.file and not (meshes / mesh.file).is_file()}
    for geom in [geom for geom in spec.geoms if geom.meshname in missing]:
        spec.delete(geom)
    for mesh in [mesh for mesh in spec.meshes if mesh.name in missing]:
        spec.delete(mesh)


@dataclass(frozen=True, eq=False)
class _Pose:
    """Poses of all bodies of both models in one state: world pose of MuJoCo's, of the robot's joints."""

    bodies: list[pin.SE3]
    joints: list[pin.SE3]


def _members(
    robot: Robot, model: mujoco.MjModel, names: MujocoNames, translation: Mapping[str, str]
) -> list[list[Member]]:
    """Bodies of each segment with their places, the one that carries its joint first.

    Raises:
        InputError: bodies do not move as the robot's segments do.
    """
    import mujoco

    place = mujoco_places(robot, model, names)
    own = {int(model.dof_bodyid[v]): joint for v, joint in _last_dofs(robot, place.v)}
    carrier = [0] * model.nbody
    for body in range(1, model.nbody):
        carrier[body] = own.get(body, carrier[int(model.body_parentid[body])])
    states = random_states(robot, robot.nominal_parameters)
    data = mujoco.MjData(model)
    members: list[list[Member]] = [[] for _ in robot.segments]
    poses = []
    for q, v, a in list(zip(states.q, states.v, states.a, strict=True))[:3]:
        place.pose(robot, data, q, v, a)
        mujoco.mj_kinematics(model, data)
        kinematics = robot.model.createData()
        pin.forwardKinematics(robot.model, kinematics, q)
        bodies = [pin.SE3(m.reshape(3, 3), p.copy()) for m, p in zip(data.xmat, data.xpos, strict=True)]
        poses.append(_Pose(bodies, [pin.SE3(pose) for pose in kinematics.oMi]))
    base = _base_placement(robot, model, poses[0], translation)
    for body in range(1, model.nbody):
        if carrier[body] == 0:
            continue
        inside = [(base * pose.joints[carrier[body]]).actInv(pose.bodies[body]) for pose in poses]
        name = model.body(body).name
        apart = max(float(np.linalg.norm(pin.log6(inside[0].actInv(other)).vector)) for other in inside)
        if apart > _SAME_FRAME:
            raise InputError(
                f"body {name!r} does not move with joint {robot.model.names[carrier[body]]!r}",
                source="MuJoCo model",
                remedy="give a model of the same robot, or map the names of its joints",
            )
        entry = Member(name, inside[0], _nominal(model, body))
        members[carrier[body] - 1].insert(0 if body in own else len(members), entry)
    for segment, inside_segment in enumerate(members):
        if not inside_segment and robot.nominal_parameters[10 * segment]:
            raise InputError(
                f"no body moves with link {robot.segments[segment].link!r}", source="MuJoCo model"
            )
    return members


def _last_dofs(robot: Robot, v: Array) -> list[tuple[int, int]]:
    """Place in MuJoCo's velocities, and index in the robot's model, of every joint's last coordinate."""
    joints = list(robot.model.joints)[1:]
    return [(int(v[joint.idx_v + joint.nv - 1]), index) for index, joint in enumerate(joints, start=1)]


def _base_placement(
    robot: Robot, model: mujoco.MjModel, pose: _Pose, translation: Mapping[str, str]
) -> pin.SE3:
    """Where the template puts the URDF's root, from a body of the root link's name; else at the origin."""
    import mujoco

    if robot.floating:
        return pin.SE3.Identity()
    root = next((f.name for f in robot.model.frames if f.type == pin.FrameType.BODY), "")
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, translation.get(root, root))
    return pose.bodies[body] if body > 0 else pin.SE3.Identity()


def _nominal(model: mujoco.MjModel, body: int) -> Array | None:
    """Ten parameters of a compiled body about its own frame; None without mass."""
    if model.body_mass[body] == 0.0:
        return None
    w, x, y, z = model.body_iquat[body]
    turn = pin.Quaternion(w, x, y, z).matrix()
    moments = turn @ np.diag(model.body_inertia[body]) @ turn.T
    inertia = pin.Inertia(float(model.body_mass[body]), model.body_ipos[body].copy(), moments)
    return np.asarray(inertia.toDynamicParameters())


def _identified_drives(robot: Robot, identification: Identification) -> Drives:
    """The robot's drives with the friction and rotor inertia that were identified and are not negative."""
    found = dict(zip(identification.drive_names, identification.drives.tolist(), strict=True))
    nominal = nominal_drives(robot)

    def values(term: str, declared: Array) -> Array:
        identified = [found.get(f"{term}.{joint}", np.nan) for joint in robot.joint_names]
        return np.array([new if new >= 0.0 else old for new, old in zip(identified, declared, strict=True)])

    return replace(
        nominal,
        viscous=values("viscous", nominal.viscous),
        coulomb=values("coulomb", nominal.coulomb),
        armature=values("armature", nominal.armature),
    )


def _set_drives(text: XmlText, robot: Robot, drives: Drives, names: Mapping[str, str]) -> None:
    joints = {str(joint.attributes.get("name")): joint for joint in text.root.everywhere("joint")}
    for k, name in enumerate(robot.joint_names):
        joint = joints.get(names.get(name, name))
        if joint is not None:
            text.set(
                joint,
                damping=number_text(drives.viscous[k]),
                frictionloss=number_text(drives.coulomb[k]),
                armature=number_text(drives.armature[k]),
            )
