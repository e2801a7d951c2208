"""SDF, the format of Gazebo: how it is written and how it is read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.export.models.model_format import (
    SERVO_TERMS,
    Body,
    Joint,
    ModelFormat,
    Rendered,
    Subject,
    Tree,
    described_tree,
)
from excite.export.models.urdf import URDF_TERMS
from excite.export.models.verification import Reading, States, read_urdf_text
from excite.export.models.xml_text import moment_texts, number_text
from excite.formats.documents import elements_of
from excite.robot.shapes.shape import Shape
from excite.robot.urdf.sdf import convert_sdf
from excite.simulation.true_parameters import PrincipalInertia

# SDF: the robot as a model of Gazebo, made anew.

VERSION = "1.10"
"""Of SDF; poses relative to named frames need 1.7, ``continuous`` and capsules 1.8 or later."""


class SdfFormat(ModelFormat):
    """A link for each body that moves, other links as frames of it; convex shapes lie beside it as OBJ files."""

    name = "sdf"
    summary = f"SDF {VERSION}, a model made anew with the robot's convex shapes (Gazebo, Drake)"
    held: ClassVar[Mapping[str, str]] = {
        "viscous": "damping",
        "coulomb": "friction",
        "torque_limit": "effort",
        "velocity_limit": "velocity",
    }
    lacks: ClassVar[Mapping[str, str]] = {
        "armature": "SDF has no rotor inertia: joints accelerate more easily than the robot's",
        **dict.fromkeys(("kp", "kd", "delay"), "SDF describes no servo; set it in the controller's plug-in"),
    }

    def render(self, subject: Subject) -> Rendered:
        """See :class:`ModelFormat`."""
        tree = described_tree(subject)
        root = Element("sdf", version=VERSION)
        model = SubElement(root, "model", name=subject.stem, canonical_link=tree.bodies[0].name)
        SubElement(model, "self_collide").text = "false"
        carriers = {joint.child: joint for joint in tree.joints}
        for index, body in enumerate(tree.bodies):
            _write_link(model, body, carriers.get(index))
        if not tree.free:
            anchor = SubElement(model, "joint", name=f"world_to_{tree.bodies[0].name}", type="fixed")
            SubElement(anchor, "parent").text = "world"
            SubElement(anchor, "child").text = tree.bodies[0].name
        for joint in tree.joints:
            _write_joint(model, joint, tree)
        for name, carrier, pose in tree.frames:
            if name == "world" or (name.startswith("__") and name.endswith("__")):
                # Reserved; a robot's own link of that name is where the world is.
                continue
            frame = SubElement(model, "frame", name=name, attached_to=tree.bodies[carrier].name)
            _write_pose(frame, pose)
        ElementTree.indent(root)
        text = b'<?xml version="1.0"?>\n' + ElementTree.tostring(root) + b"\n"
        return Rendered(
            {f"{subject.stem}.sdf": text, **dict(_mesh_files(tree))}, tree.notes, subject.changed_links
        )

    def read(self, subject: Subject, rendered: Rendered, states: States) -> Reading:
        """Read as an SDF of somebody else is, as the URDF that it says, by pinocchio."""
        text = convert_sdf(elements_of(rendered.files[rendered.main]), Path(rendered.main))
        return read_urdf_text(subject.robot, text, states, URDF_TERMS)


def _write_link(model: Element, body: Body, carrier: Joint | None) -> None:
    link = SubElement(model, "link", name=body.name)
    if carrier is not None:
        SubElement(link, "pose", relative_to=carrier.name).text = "0 0 0 0 0 0"
    if body.inertia is not None:
        _write_inertial(link, body.inertia)
    for shape in body.shapes:
        for kind in ("visual", "collision"):
            solid = SubElement(link, kind, name=f"{shape.name}_{kind}")
            _write_pose(solid, shape.placement)
            _write_geometry(SubElement(solid, "geometry"), shape)


def _write_inertial(link: Element, own: PrincipalInertia) -> None:
    inertial = SubElement(link, "inertial")
    SubElement(inertial, "pose").text = f"{number_text(*own.com)} 0 0 0"
    SubElement(inertial, "mass").text = number_text(own.mass)
    inertia = SubElement(inertial, "inertia")
    full = own.rotation @ np.diag(own.moments) @ own.rotation.T
    for name, value in moment_texts(full).items():
        SubElement(inertia, name).text = value


def _write_joint(model: Element, joint: Joint, tree: Tree) -> None:
    element = SubElement(model, "joint", name=joint.name, type="prismatic" if joint.slides else "revolute")
    SubElement(element, "pose", relative_to=tree.bodies[joint.parent].name).text = _format_pose(
        joint.placement
    )
    SubElement(element, "parent").text = tree.bodies[joint.parent].name
    SubElement(element, "child").text = tree.bodies[joint.child].name
    axis = SubElement(element, "axis")
    SubElement(axis, "xyz").text = number_text(*joint.axis)
    limit, dynamics = SubElement(axis, "limit"), SubElement(axis, "dynamics")
    SubElement(limit, "lower").text, SubElement(limit, "upper").text = (number_text(v) for v in joint.range)
    for term, name in SdfFormat.held.items():
        inside = limit if term in SERVO_TERMS else dynamics
        SubElement(inside, name).text = number_text(joint.terms.get(term, np.inf))


def _write_geometry(geometry: Element, shape: Shape) -> None:
    if shape.vertices is not None:
        mesh = SubElement(geometry, "mesh")
        SubElement(mesh, "uri").text = _mesh_name(shape)
        return
    solid = SubElement(geometry, shape.kind)
    if shape.kind == "box":
        SubElement(solid, "size").text = number_text(*shape.size)
        return
    SubElement(solid, "radius").text = number_text(shape.size[0])
    if shape.kind != "sphere":
        SubElement(solid, "length").text = number_text(shape.size[1])


def _mesh_name(shape: Shape) -> str:
    return f"meshes/{shape.name}.obj"


def _mesh_files(tree: Tree) -> list[tuple[str, bytes]]:
    """Convex shapes as OBJ files, corners in metres."""
    files = []
    for body in tree.bodies:
        for shape in body.shapes:
            if shape.vertices is not None and shape.faces is not None:
                lines = [f"v {number_text(*corner)}" for corner in _round_corners(shape.vertices)]
                lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in shape.faces]
                files.append((_mesh_name(shape), ("\n".join(lines) + "\n").encode()))
    return files


def _round_corners(corners: Array) -> Array:
    """Corners to the micrometre, which is less than a hull is off its mesh."""
    return np.round(corners, 6)


def _write_pose(element: Element, pose: pin.SE3) -> None:
    SubElement(element, "pose").text = _format_pose(pose)


def _format_pose(pose: pin.SE3) -> str:
    """Place and roll, pitch, yaw, as SDF has them (about fixed axes)."""
    return number_text(*pose.translation, *pin.rpy.matrixToRpy(pose.rotation))
