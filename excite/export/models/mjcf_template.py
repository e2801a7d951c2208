"""A MuJoCo model of a robot as its author wrote it, and its text with other inertials and friction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError
from excite.export.models.mjcf_compiled import compile_mjcf
from excite.export.models.parameters import (
    Member,
    changed_segments,
    drive_attributes,
    moved_pseudo,
    split_segment,
)
from excite.export.models.verification import mujoco_places, random_states
from excite.export.models.xml_text import Element, XmlText, number_text
from excite.formats.documents import MAX_XML_BYTES
from excite.formats.file import read_bytes
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.inertia import pseudo_inertia_matrices
from excite.robot.mjcf.scan import scan_mjcf
from excite.robot.robot import Robot
from excite.simulation.true_parameters import principal_inertia

if TYPE_CHECKING:
    import mujoco


# Bodies of a MuJoCo model that a robot's segments consist of.

# How far apart frames of one body may lie in the file and in the robot from one posture to another [m, rad], and how
# far, relatively, bodies' inertia may be from what was found and be left alone. MuJoCo writes six digits.
_SAME = 1e-4


@dataclass(frozen=True, eq=False)
class _Pose:
    """Poses of all bodies of both models in one state: world pose of MuJoCo's, of the robot's joints."""

    bodies: list[pin.SE3]
    joints: list[pin.SE3]


def segment_bodies(robot: Robot, model: mujoco.MjModel, names: Mapping[str, str]) -> list[list[Member]]:
    """Bodies of each segment with their places, the one that carries its joint first.

    Args:
        robot: the robot.
        model: the model.
        names: names of links and joints in it, where they are not the robot's.

    Raises:
        InputError: bodies do not move as the robot's segments do.
    """
    import mujoco

    place = mujoco_places(robot, model, names)
    joints = list(robot.model.joints)[1:]
    # The body of every joint's last coordinate.
    own = {
        int(model.dof_bodyid[place.v[joint.idx_v + joint.nv - 1]]): index
        for index, joint in enumerate(joints, start=1)
    }
    carrier = [0] * model.nbody
    for body in range(1, model.nbody):
        carrier[body] = own.get(body, carrier[int(model.body_parentid[body])])
    states = random_states(robot, robot.nominal_parameters)
    data = mujoco.MjData(model)
    members: list[list[Member]] = [[] for _ in robot.segments]
    poses = []
    for q, v in list(zip(states.q, states.v, strict=True))[:3]:
        data.qpos[:], data.qvel[:] = place.mujoco_state(robot, q, v)
        mujoco.mj_kinematics(model, data)
        kinematics = robot.model.createData()
        pin.forwardKinematics(robot.model, kinematics, q)
        bodies = [pin.SE3(m.reshape(3, 3), p.copy()) for m, p in zip(data.xmat, data.xpos, strict=True)]
        poses.append(_Pose(bodies, [pin.SE3(pose) for pose in kinematics.oMi]))
    base = _base_placement(robot, model, poses[0], names)
    for body in range(1, model.nbody):
        if carrier[body] == 0:
            continue
        inside = [(base * pose.joints[carrier[body]]).actInv(pose.bodies[body]) for pose in poses]
        # A body without a name is still named in notes and errors.
        name = model.body(body).name or f"body number {body}"
        apart = max(float(np.linalg.norm(pin.log6(inside[0].actInv(other)).vector)) for other in inside)
        if apart > _SAME:
            raise InputError(
                f"body {name!r} does not move with joint {robot.model.names[carrier[body]]!r}",
                source="MuJoCo model",
                remedy="give a model of the same robot, or map the names of its joints",
            )
        entry = Member(name, inside[0], _compiled_parameters(model, body))
        members[carrier[body] - 1].insert(0 if body in own else len(members), entry)
    for segment, inside_segment in enumerate(members):
        if not inside_segment and robot.nominal_parameters[10 * segment]:
            raise InputError(
                f"no body moves with link {robot.segments[segment].link!r}", source="MuJoCo model"
            )
    return members


def _base_placement(robot: Robot, model: mujoco.MjModel, pose: _Pose, names: Mapping[str, str]) -> pin.SE3:
    """Where the template puts the URDF's root, from a body of the root link's name; else at the origin."""
    import mujoco

    if robot.floating:
        return pin.SE3.Identity()
    root = next((f.name for f in robot.model.frames if f.type == pin.FrameType.BODY), "")
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, names.get(root, root))
    return pose.bodies[body] if body > 0 else pin.SE3.Identity()


def _compiled_parameters(model: mujoco.MjModel, body: int) -> Array | None:
    """Ten parameters of a compiled body about its own frame; None without mass."""
    if model.body_mass[body] == 0.0:
        return None
    w, x, y, z = model.body_iquat[body]
    turn = pin.Quaternion(w, x, y, z).matrix()
    moments = turn @ np.diag(model.body_inertia[body]) @ turn.T
    inertia = pin.Inertia(float(model.body_mass[body]), model.body_ipos[body].copy(), moments)
    return np.asarray(inertia.toDynamicParameters())


def segment_difference(members: list[Member], total: Array) -> float:
    """How far bodies together are from a segment's parameters, relative to the pseudo-inertia."""
    target = pseudo_inertia_matrices(total)[0]
    for member in members:
        if member.parameters is not None:
            target = target - moved_pseudo(pseudo_inertia_matrices(member.parameters)[0], member.placement)
    scale = float(np.abs(pseudo_inertia_matrices(total)).max())
    return float(np.abs(target).max()) / scale if scale else 0.0


# A MuJoCo model of a robot as its author wrote it, and its text with other inertials and friction.

_ORIENTATIONS = ("euler", "axisangle", "xyaxes", "zaxis")
DRIVE_ATTRIBUTES = {"viscous": "damping", "coulomb": "frictionloss", "armature": "armature"}


@dataclass(frozen=True, eq=False)
class TemplateEdit:
    """A template's text with its edits collected.

    Attributes:
        text: the text.
        segments: indices of the segments that are others now.
        changed: bodies whose inertial is another one.
        notes: what had to be decided, one sentence each.
    """

    text: XmlText
    segments: tuple[int, ...]
    changed: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class MjcfTemplate:
    """A MuJoCo model of a robot.

    Attributes:
        file: where it lies.
        content: its text.
        members: bodies of each segment, as compiled.
        names: names of links and joints in it, where they are not the robot's.
    """

    file: Path
    content: bytes
    members: list[list[Member]]
    names: Mapping[str, str]

    def edited(self, robot: Robot, found: IdentifiedParameters) -> TemplateEdit:
        """Its text with the inertials, friction and rotor inertia that were found.

        Raises:
            InconsistentModelError: a segment is no rigid body; MuJoCo refuses such models.
            InputError: the identification is of another robot, or the text includes another that has the bodies.
        """
        changed = changed_segments(robot, found, force=False)
        ten = found.inertial.reshape(-1, 10)
        text = XmlText(self.content, self.file)
        bodies = {str(body.attributes.get("name")): body for body in text.root.everywhere("body")}
        other = [k for k in range(len(ten)) if segment_difference(self.members[k], ten[k]) > _SAME]
        segments = tuple(sorted({*changed, *other}))
        notes, written = [], []
        for segment in segments:
            split = split_segment(ten[segment], self.members[segment])
            notes += [split.note] if split.note else []
            for body, parameters in split.shares.items():
                if body not in bodies:
                    raise InputError(
                        f"has no <body name={body!r}> in its own text",
                        source=self.file,
                        remedy="give the file that describes the bodies, not one that includes it",
                    )
                set_inertial(text, bodies[body], parameters, body)
                written.append(body)
        joints = {str(joint.attributes.get("name")): joint for joint in text.root.everywhere("joint")}
        for name in robot.joint_names:
            values = drive_attributes(found, name, DRIVE_ATTRIBUTES, notes)
            # What was not found stays the file's own.
            if values and self.names.get(name, name) in joints:
                text.set(joints[self.names.get(name, name)], **values)
        return TemplateEdit(text, segments, tuple(written), tuple(notes))


def read_template(robot: Robot, file: Path, names: Mapping[str, str]) -> MjcfTemplate:
    """Read a MuJoCo model of a robot.

    Args:
        robot: the robot.
        file: the model.
        names: names of links and joints in it, where they are not the robot's.

    Raises:
        InputError: the file is another robot's, or MuJoCo refuses it.
    """
    content = read_mjcf(file)
    nominal = compile_mjcf(content, file)
    members = segment_bodies(robot, nominal, names)
    return MjcfTemplate(file, content, members, names)


def read_mjcf(file: Path) -> bytes:
    """The text of a MuJoCo model, looked through; raises RobotError."""
    scan_mjcf(file)
    return read_bytes(file, limit=MAX_XML_BYTES)


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
    for other in _ORIENTATIONS:
        text.remove_attribute(found[0], other)
    text.set(found[0], **values, **diagonal)
