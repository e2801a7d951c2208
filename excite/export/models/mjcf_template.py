"""A MuJoCo model of a robot as its author wrote it, and its text with other inertials and friction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError
from excite.export.models.bodies import Member, changed_segments, split_segment
from excite.export.models.mjcf_bodies import segment_bodies, segment_difference
from excite.export.models.mjcf_compiled import compile_mjcf
from excite.export.models.mujoco_places import MujocoNames, robot_names
from excite.export.models.parameters import Found
from excite.export.models.verification import held_joints
from excite.export.models.xml_text import Element, XmlText, number_text
from excite.reading.file import read_bytes
from excite.reading.xml_document import MAX_XML_BYTES
from excite.robot.loading import model_file
from excite.robot.mjcf.scan import scan_mjcf
from excite.robot.robot import Robot
from excite.robot.urdf.reading import parse_urdf
from excite.simulation.inertial import principal_inertia

# Bodies of a template that are nearer to the identified parameters, relatively, are left alone.
_SAME_INERTIA = 1e-4
_ORIENTATIONS = ("quat", "euler", "axisangle", "xyaxes", "zaxis")
_ATTRIBUTES = {"viscous": "damping", "coulomb": "frictionloss", "armature": "armature"}


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

    def edited(self, robot: Robot, identification: Found, *, drives: bool) -> TemplateEdit:
        """Its text with identified inertials and, with ``drives``, friction and rotor inertia.

        Raises:
            InconsistentModelError: a segment is no rigid body; MuJoCo refuses such models.
            InputError: the identification is of another robot, or the text includes another that has the bodies.
        """
        changed = changed_segments(robot, identification, force=False)
        ten = identification.parameters.reshape(-1, 10)
        text = XmlText(self.content, self.file)
        bodies = {str(body.attributes.get("name")): body for body in text.root.everywhere("body")}
        other = [k for k in range(len(ten)) if segment_difference(self.members[k], ten[k]) > _SAME_INERTIA]
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
        if drives:
            notes += self._set_drives(text, robot, identification.identified.by_drive())
        return TemplateEdit(text, segments, tuple(written), tuple(notes))

    def _set_drives(self, text: XmlText, robot: Robot, found: Mapping[str, float]) -> list[str]:
        """Put what was identified into its joints; what was not stays the file's own."""
        joints = {str(joint.attributes.get("name")): joint for joint in text.root.everywhere("joint")}
        notes = []
        for name in robot.joint_names:
            joint = joints.get(self.names.get(name, name))
            values = {}
            for term, attribute in _ATTRIBUTES.items():
                value = found.get(f"{term}.{name}")
                if value is not None and value < 0.0:
                    notes.append(f"{name}: {term} was identified as {value:.3g}, below zero; not written")
                elif value is not None:
                    values[attribute] = number_text(value)
            if joint is not None and values:
                text.set(joint, **values)
        return notes


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
    members = segment_bodies(robot, nominal, template_names(robot, names), names)
    return MjcfTemplate(file, content, members, names)


def read_mjcf(file: Path) -> bytes:
    """The text of a MuJoCo model, looked through; raises RobotError."""
    scan_mjcf(file)
    return read_bytes(file, limit=MAX_XML_BYTES)


def template_names(robot: Robot, names: Mapping[str, str]) -> MujocoNames:
    """Names of the robot's joints in a MuJoCo model, and where joints stand that the robot holds still."""
    return robot_names(robot, names, held_joints(robot, parse_urdf(model_file(robot))))


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
