"""A URDF with identified inertials: its author's text, with other numbers in ``<inertial>`` and ``<dynamics>``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError
from excite.export.models.model_format import ModelFormat, Rendered, Subject, XmlText, move_attribute
from excite.export.models.parameters import (
    Member,
    centred_body,
    changed_segments,
    drive_attributes,
    moved_pseudo,
    split_segment,
)
from excite.export.models.verification import Reading, States, held_joints, read_urdf_text
from excite.formats.documents import MAX_XML_BYTES, parse_xml
from excite.formats.file import read_bytes
from excite.identification.inertia import parameters_of_pseudo_inertia, pseudo_inertia_matrices
from excite.robot.links import link_placement
from excite.robot.loading import model_file
from excite.robot.robot import Robot
from excite.robot.urdf.inertia import Inertial, read_inertial
from excite.robot.urdf.reading import parse_urdf
from excite.robot.urdf.tree import MOVING, WORLD, declare_world
from excite.robot.urdf.writing import MOMENTS, number_text

# By term that a URDF holds: the element of a joint, its attribute there, and what one that is missing stands for.
URDF_TERMS = {"viscous": ("dynamics", "damping", 0.0), "coulomb": ("dynamics", "friction", 0.0)}


class UrdfFormat(ModelFormat):
    """The URDF that the robot came as: comments, order, shapes and limits stay, inertials and ``<dynamics>`` change.

    ``rpy`` of an inertial stays too (its moments are expressed in that frame), and links whose segment did not change
    are not touched. A robot that came as MJCF has the URDF that was made of it.
    """

    name = "urdf"
    summary = "URDF, the author's text kept (ROS, Gazebo, pinocchio, Drake, PyBullet)"
    held: ClassVar[Mapping[str, str]] = {"viscous": "damping", "coulomb": "friction"}
    lacks: ClassVar[Mapping[str, str]] = {
        "armature": "URDF has no rotor inertia; add it where the simulator sets it",
        **dict.fromkeys(("kp", "kd", "delay"), "URDF describes no servo; set it in the controller"),
    }

    def render(self, subject: Subject) -> Rendered:
        """See :class:`ModelFormat`.

        Raises:
            InconsistentModelError: a changed segment is no rigid body, and the subject is not forced.
            InputError: the identification is of another robot, or the URDF has changed since it was loaded.
        """
        robot, found = subject.robot, subject.found
        changed, file = changed_segments(robot, found, force=subject.force), model_file(robot)
        # Without the bare link from which a free base floats.
        loaded = {str(link.get("name")): link for link in parse_urdf(file).findall("link")}
        content = read_bytes(file, limit=MAX_XML_BYTES)
        text = XmlText(content, file)
        links = {str(link.get("name")): link for link in text.root.findall("link")}
        if declare_world(parse_xml(content, file)):
            text.root.insert(0, Element("link", name=WORLD))
        members = _segment_members(robot, {name: loaded[name] for name in links if name in loaded}, file)
        notes = _complete_limits(text.root, robot)
        written: list[str] = []
        for segment in changed:
            split = split_segment(found.inertial.reshape(-1, 10)[segment], members[segment])
            notes += [split.note] if split.note else []
            for link, parameters in split.shares.items():
                _set_inertial(links[link], parameters, link)
                written.append(link)
        for joint in text.root.findall("joint"):
            values = drive_attributes(found, str(joint.get("name")), self.held, notes)
            if values:
                _ensure_part(joint, "dynamics").attrib.update(values)
        for mesh in text.root.iter("mesh"):
            move_attribute(mesh, "filename", file.parent, subject.folder)
        held = held_joints(robot)
        if held:
            notes.append(
                "links beyond the joints that robot.yaml holds still kept their nominal inertia; the sum of their "
                f"segment is the identified one while {', '.join(held)} stay where they are held"
            )
        return Rendered({f"{subject.stem}.urdf": text.edited()}, tuple(notes), tuple(written))

    def read(self, subject: Subject, rendered: Rendered, states: States) -> Reading:
        """Read by pinocchio, ``<dynamics>`` by the XML's own words."""
        return read_urdf_text(subject.robot, rendered.files[rendered.model], states, URDF_TERMS)


def _segment_members(robot: Robot, links: Mapping[str, Element], file: Path) -> list[list[Member]]:
    """Links of each segment, the moving one first; raises InputError where they are not those that were loaded."""
    members: list[list[Member]] = [[] for _ in robot.segments]
    totals = np.zeros((len(members), 4, 4))
    for name, link in links.items():
        joint, placement = link_placement(robot.model, name, file, f"link {name!r}")
        if joint == 0:
            continue
        own: Array | None = None
        if link.find("inertial") is not None:
            own = (read_inertial(link, file) or Inertial()).ten_parameters
            totals[joint - 1] += moved_pseudo(pseudo_inertia_matrices(own)[0], placement)
        inside = members[joint - 1]
        first = name == robot.segments[joint - 1].link
        inside.insert(0 if first else len(inside), Member(name, placement, own))
    for segment, total, nominal in zip(
        robot.segments, totals, robot.nominal_parameters.reshape(-1, 10), strict=True
    ):
        room = 1e-9 * (1.0 + np.abs(nominal).max())
        if not np.allclose(parameters_of_pseudo_inertia(total), nominal, rtol=1e-6, atol=room):
            raise InputError(
                f"does not hold the parameters of {segment.link!r} that were loaded",
                source=file,
                remedy="load the robot again",
            )
    return members


def _ensure_part(element: Element, tag: str) -> Element:
    """The part of an element that is called so, put in where it is missing."""
    found = element.find(tag)
    if found is None:
        found = Element(tag)
        element.insert(0, found)
    return found


def _set_inertial(link: Element, parameters: Array, name: str) -> None:
    body, turn = centred_body(parameters, name), np.eye(3)
    inertial = _ensure_part(link, "inertial")
    origin = _ensure_part(inertial, "origin")
    if "rpy" in origin.keys():
        # Read before with the robot: three numbers.
        turn = pin.rpy.rpyToMatrix(*map(float, origin.get("rpy", "").split()))
    origin.set("xyz", number_text(*body.lever))
    moments = (turn.T @ body.inertia @ turn)[np.triu_indices(3)]
    for tag, values in (
        ("mass", {"value": number_text(body.mass)}),
        ("inertia", dict(zip(MOMENTS, map(number_text, moments), strict=True))),
    ):
        found = inertial.find(tag)
        (SubElement(inertial, tag) if found is None else found).attrib.update(values)


def _complete_limits(root: Element, robot: Robot) -> list[str]:
    """Write efforts and velocities where the model has limits without: the robot's, 0 of joints that are held.

    Returns a sentence with the joints concerned; none where all limits are complete.
    """
    known = {"effort": robot.limits.torque, "velocity": robot.limits.velocity}
    own = {
        name: {word: float(values[k]) for word, values in known.items()}
        for k, name in enumerate(robot.joint_names)
    }
    found = []
    for joint in root.findall("joint"):
        name = str(joint.get("name"))
        for limit in joint.findall("limit") if joint.get("type") in MOVING else ():
            missing = [word for word in known if word not in limit.keys()]
            limit.attrib.update({word: number_text(own.get(name, {}).get(word, 0.0)) for word in missing})
            found += [name] * bool(missing)
    return (
        [f"limits of {', '.join(found)} lacked an effort or a velocity: the description's"] if found else []
    )
