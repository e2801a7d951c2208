"""MJCF: the author's text with identified physics, or a model made from the robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError
from excite.export.models.mjcf_compiled import compile_mjcf, compile_text
from excite.export.models.model_format import (
    ModelFormat,
    Rendered,
    Subject,
    XmlText,
    move_attribute,
    relocate_path,
)
from excite.export.models.parameters import (
    Member,
    changed_segments,
    drive_attributes,
    moved_pseudo,
    split_segment,
)
from excite.export.models.verification import Reading, States, mujoco_places, mujoco_torques, random_states
from excite.formats.documents import MAX_XML_BYTES
from excite.formats.file import read_bytes
from excite.identification.inertia import parameters_of_pseudo_inertia, pseudo_inertia_matrices
from excite.robot.mjcf.conversion import scan_mjcf
from excite.robot.robot import Robot
from excite.robot.urdf.writing import number_text
from excite.simulation.mjcf import World, build_spec, mujoco_quaternion
from excite.simulation.true_parameters import principal_inertia

if TYPE_CHECKING:
    import mujoco

_OWN_MOTORS = "the author's actuators were left as they are; set it there"
FILTERED = "commands pass a filter of {late:.3g} s, which is how late the motors were found to follow"
_FOLDERS = {"mesh": "meshdir", "hfield": "meshdir", "skin": "meshdir", "texture": "texturedir"}
_DRIVES = {"viscous": "damping", "coulomb": "frictionloss", "armature": "armature"}
# How far apart frames of one body may lie in the file and in the robot from one posture to another [m, rad], and how
# far, relatively, bodies' inertia may be from what was found and be left alone. MuJoCo writes six digits.
_SAME = 1e-4


class MjcfFormat(ModelFormat):
    """A MuJoCo model.

    Of a robot that came as MJCF it is that text: shapes, contacts, defaults, sensors and actuators stay, inertials,
    ``damping``, ``frictionloss`` and ``armature`` change. Of any other it is made here, with a position servo a joint.
    """

    name = "mjcf"
    summary = "MuJoCo model; of a robot that came as MJCF the author's text is kept (MuJoCo, MJX)"
    held: ClassVar[Mapping[str, str]] = {
        **_DRIVES,
        "kp": "gainprm",
        "kd": "biasprm",
        "torque_limit": "forcerange",
        "delay": "dynprm",
    }
    lacks: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("kp", "kd", "torque_limit", "delay"), _OWN_MOTORS),
        "velocity_limit": "MuJoCo holds no joint below a speed; keep commands below it",
    }

    def render(self, subject: Subject) -> Rendered:
        """See :class:`ModelFormat`."""
        name, given = f"{subject.stem}.xml", subject.template
        if given is not None:
            return _edit_template(subject, name, given)
        notes = () if subject.delay_s is None else (FILTERED.format(late=subject.delay_s),)
        return Rendered({name: exact_text(model_spec(subject))}, notes, subject.changed_links)

    def read(self, subject: Subject, rendered: Rendered, states: States) -> Reading:
        """Read by MuJoCo, where paths in it start at the folder that it is for."""
        content, robot = rendered.files[rendered.model], subject.robot
        made = subject.template is None
        model = (
            compile_text(content, None) if made else compile_mjcf(content, subject.folder / rendered.model)
        )
        place = mujoco_places(robot, model).v[robot.n_base_v :]
        terms = {term: getattr(model, f"dof_{name}")[place].copy() for term, name in _DRIVES.items()}
        bodies = segment_bodies(robot, model)
        inertial = [parameters_of_pseudo_inertia(_sum_bodies(members)) for members in bodies]
        servos = _servo_terms(model, robot.joint_names) if made else {}
        return Reading(mujoco_torques(robot, model, states), np.concatenate(inertial), terms | servos)

    def servo(self, subject: Subject) -> tuple[str, ...]:
        """A text that is kept keeps its actuators."""
        return super().servo(subject) if subject.template is None else ()

    def exact(self, subject: Subject) -> bool:
        """A text that is kept may have springs, and bodies that are some parts in ten thousand off the robot's."""
        return subject.template is None


def model_spec(subject: Subject) -> mujoco.MjSpec:
    """A model made from the robot, with a servo a joint; a delay is the time constant of a filter of its command."""
    import mujoco

    terms: dict[str, Any] = {term: subject.written(term) for term in MjcfFormat.held if term != "delay"}
    drives = replace(subject.declared, **terms)
    spec = build_spec(subject.robot, subject.parameters, drives, World())
    late = subject.servo("delay")
    for name, constant in zip(subject.robot.joint_names, late, strict=True):
        if np.isfinite(constant):
            motor = spec.actuator(name)
            motor.dyntype, motor.dynprm[0] = mujoco.mjtDyn.mjDYN_FILTEREXACT, constant
    return spec


def exact_text(spec: mujoco.MjSpec) -> bytes:
    """A specification as XML with all digits of its kinematics and inertials; MuJoCo writes six."""
    text = XmlText(spec.to_xml().encode("utf-8"), spec.modelname)

    def set_exactly(element: Element, **values: Any) -> None:
        element.attrib.update({name: number_text(*np.atleast_1d(value)) for name, value in values.items()})

    for element in text.root.iter("body"):
        body = spec.body(str(element.get("name")))
        set_exactly(element, pos=body.pos, quat=body.quat)
        joints = {joint.name: joint for joint in body.joints}
        for joint in element.findall("joint"):
            found = joints[str(joint.get("name"))]
            drive = {
                name: np.ravel(getattr(found, name))[0] for name in _DRIVES.values() if name in joint.keys()
            }
            set_exactly(joint, axis=found.axis, range=found.range, **drive)
        for inertial in element.findall("inertial"):
            set_exactly(inertial, pos=body.ipos, quat=body.iquat, mass=body.mass, diaginertia=body.inertia)
    return text.edited()


def _servo_terms(model: mujoco.MjModel, names: tuple[str, ...]) -> dict[str, Array]:
    """Terms of the position servos that are named like their joints; NaN where a joint has none."""
    import mujoco

    rows = np.full((4, len(names)), np.nan)
    for column, name in enumerate(names):
        motor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name)
        if motor >= 0:
            late = model.actuator_dynprm[motor, 0] if model.actuator_dyntype[motor] else np.nan
            gain, bias = model.actuator_gainprm[motor], model.actuator_biasprm[motor]
            rows[:, column] = gain[0], -bias[2], model.actuator_forcerange[motor, 1], late
    return dict(zip(("kp", "kd", "torque_limit", "delay"), rows, strict=True))


# Bodies of a MuJoCo model that a robot's segments consist of.


def segment_bodies(robot: Robot, model: mujoco.MjModel) -> list[list[Member]]:
    """Bodies of each segment with their places, the one that carries its joint first.

    Raises:
        InputError: bodies do not move as the robot's segments do.
    """
    import mujoco

    place = mujoco_places(robot, model)
    # The body of every joint's last coordinate.
    own = {
        int(model.dof_bodyid[place.v[joint.idx_v + joint.nv - 1]]): index
        for index, joint in enumerate(list(robot.model.joints)[1:], start=1)
    }
    carrier = [0] * model.nbody
    for body in range(1, model.nbody):
        carrier[body] = own.get(body, carrier[int(model.body_parentid[body])])
    # Where the model puts the robot's root: from a body of the root link's name; else at the origin.
    root = next((f.name for f in robot.model.frames if f.type == pin.FrameType.BODY), "")
    base = -1 if robot.floating else mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, root)
    inside: list[list[pin.SE3]] = [[] for _ in range(model.nbody)]
    states, data, kinematics = (
        random_states(robot, robot.nominal_parameters),
        mujoco.MjData(model),
        robot.model.createData(),
    )
    for q, v in list(zip(states.q, states.v, strict=True))[:3]:
        data.qpos[:], data.qvel[:] = place.mujoco_state(robot, q, v)
        mujoco.mj_kinematics(model, data)
        pin.forwardKinematics(robot.model, kinematics, q)
        poses = [pin.SE3(m.reshape(3, 3), p.copy()) for m, p in zip(data.xmat, data.xpos, strict=True)]
        stands = poses[base] if base > 0 else pin.SE3.Identity()
        for body, joint in enumerate(carrier):
            inside[body].append((stands * kinematics.oMi[joint]).actInv(poses[body]))
    members: list[list[Member]] = [[] for _ in robot.segments]
    for body, joint in enumerate(carrier):
        if joint == 0:
            continue
        # A body without a name is still named in notes and errors.
        name, first = model.body(body).name or f"body number {body}", inside[body][0]
        if max(float(np.linalg.norm(pin.log6(first.actInv(other)).vector)) for other in inside[body]) > _SAME:
            raise InputError(
                f"body {name!r} does not move with joint {robot.model.names[joint]!r}",
                source="MuJoCo model",
                remedy="give a model of the same robot",
            )
        inside_segment = members[joint - 1]
        inside_segment.insert(
            0 if body in own else len(inside_segment), Member(name, first, _body_parameters(model, body))
        )
    for segment, nominal, found in zip(
        robot.segments, robot.nominal_parameters.reshape(-1, 10), members, strict=True
    ):
        if not found and nominal[0]:
            raise InputError(f"no body moves with link {segment.link!r}", source="MuJoCo model")
    return members


def _body_parameters(model: mujoco.MjModel, body: int) -> Array | None:
    """Ten parameters of a compiled body about its own frame; None without mass."""
    if model.body_mass[body] == 0.0:
        return None
    turn = pin.Quaternion(*model.body_iquat[body]).matrix()
    moments = turn @ np.diag(model.body_inertia[body]) @ turn.T
    inertia = pin.Inertia(float(model.body_mass[body]), model.body_ipos[body].copy(), moments)
    return np.asarray(inertia.toDynamicParameters())


def _sum_bodies(members: Sequence[Member]) -> Array:
    """Pseudo-inertia of bodies together about their joint's frame, ``(4, 4)``."""
    moved = (
        moved_pseudo(pseudo_inertia_matrices(one.parameters)[0], one.placement)
        for one in members
        if one.parameters is not None
    )
    return np.asarray(np.sum([np.zeros((4, 4)), *moved], axis=0))


# A MuJoCo model of a robot as its author wrote it, and its text with other inertials and friction.


def read_template(robot: Robot, file: Path) -> list[list[Member]]:
    """Bodies of each segment in a MuJoCo model of a robot; raises InputError where it is another's, or none."""
    scan_mjcf(file)
    return segment_bodies(robot, compile_mjcf(read_bytes(file, limit=MAX_XML_BYTES), file))


def _edit_template(subject: Subject, name: str, file: Path) -> Rendered:
    """A text with the inertials, friction and rotor inertia that were found.

    Raises:
        InconsistentModelError: a segment is no rigid body; MuJoCo refuses such models.
        InputError: the identification is of another robot, or the text includes another that has the bodies.
    """
    robot, found = subject.robot, subject.found
    given = read_template(robot, file)
    content = read_bytes(file, limit=MAX_XML_BYTES)
    segments = set(changed_segments(robot, found, force=False))
    ten, text = found.inertial.reshape(-1, 10), XmlText(content, file)
    pseudo = pseudo_inertia_matrices(found.inertial)
    for k, (target, members) in enumerate(zip(pseudo, given, strict=True)):
        if np.abs(target - _sum_bodies(members)).max() > _SAME * np.abs(target).max() > 0.0:
            segments.add(k)
    bodies = {str(body.get("name")): body for body in text.root.iter("body")}
    notes, changed = [], []
    for segment in sorted(segments):
        split = split_segment(ten[segment], given[segment])
        notes += [split.note] if split.note else []
        for body, parameters in split.shares.items():
            if body not in bodies:
                raise InputError(
                    f"has no <body name={body!r}> in its own text",
                    source=file,
                    remedy="give the file that describes the bodies, not one that includes it",
                )
            _set_inertial(bodies[body], parameters, body)
            changed.append(body)
    joints = {str(joint.get("name")): joint for joint in text.root.iter("joint")}
    for joint in robot.joint_names:
        values = drive_attributes(found, joint, _DRIVES, notes)
        # What was not found stays the file's own.
        if joint in joints:
            joints[joint].attrib.update(values)
    _move_paths(text.root, file.parent, subject.folder)
    return Rendered({name: text.edited()}, tuple(notes), tuple(changed))


def _set_inertial(body: Element, parameters: Array, name: str) -> None:
    """Give a body ten parameters about its own frame; raises UnphysicalParametersError where no rigid body has them."""
    if not parameters.any():
        return
    inertia = principal_inertia(parameters, name)
    values = {"pos": number_text(*inertia.com), "mass": number_text(inertia.mass)}
    element = body.find("inertial")
    if element is None:
        element = Element("inertial")
        body.insert(0, element)
    if "fullinertia" in element.keys():
        full = inertia.rotation @ np.diag(inertia.moments) @ inertia.rotation.T
        values["fullinertia"] = number_text(*full[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    else:
        values |= {
            "quat": number_text(*mujoco_quaternion(inertia.rotation)),
            "diaginertia": number_text(*inertia.moments),
        }
        for other in ("euler", "axisangle", "xyaxes", "zaxis"):
            element.attrib.pop(other, None)
    element.attrib.update(values)


def _move_paths(root: Element, old: Path, new: Path) -> None:
    """Let a text name the same files from another folder."""
    if old.resolve() == new.resolve():
        return
    for include in root.iter("include"):
        move_attribute(include, "file", old, new)
    compilers = root.findall("compiler")
    for tag, attribute in _FOLDERS.items():
        elements = [element for element in root.iter(tag) if "file" in element.keys()]
        stated = next((c for c in compilers if {attribute, "assetdir"} & set(c.keys())), None)
        if elements and stated is not None:
            name = stated.get(attribute) or stated.get("assetdir", "")
            stated.set(attribute, relocate_path(name or ".", old, new))
            continue
        for element in elements:
            move_attribute(element, "file", old, new)
