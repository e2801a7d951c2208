"""SDF, the format of Gazebo: how it is written and how it is read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin
from defusedxml.ElementTree import fromstring

from excite.arrays import Array
from excite.errors import InputError
from excite.export.models.xml_text import number_text
from excite.export.simulators.model_format import LoadedModel, ModelFormat, Rendered, Subject
from excite.export.simulators.tree import Body, Joint, LoadedTree, ReadBody, ReadJoint, Tree, described_tree
from excite.robot.robot import Robot
from excite.robot.shapes.shape import Shape
from excite.simulation.true_parameters import PrincipalInertia

# SDF: the robot as a model of Gazebo, made anew.

VERSION = "1.10"
"""Of SDF; poses relative to named frames need 1.7, ``continuous`` and capsules 1.8 or later."""

_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_UPPER = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])
_NO_SERVO = "SDF describes no servo; set it in the controller's plug-in"


class SdfFormat(ModelFormat):
    """A link for each body that moves, other links as frames of it; convex shapes lie beside it as OBJ files."""

    name = "sdf"
    summary = f"SDF {VERSION}, a model made anew with the robot's convex shapes (Gazebo, Drake)"
    terms = ("viscous", "coulomb")
    servo_terms = ("torque_limit", "velocity_limit")
    lacks: ClassVar[Mapping[str, str]] = {
        "armature": "SDF has no rotor inertia: joints accelerate more easily than the robot's",
        "kp": _NO_SERVO,
        "kd": _NO_SERVO,
        "delay": _NO_SERVO,
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
        return Rendered({f"{subject.stem}.sdf": text, **dict(_mesh_files(tree))}, tree.notes)

    def load(self, subject: Subject, rendered: Rendered) -> LoadedModel:
        """Read by the XML's own words."""
        return read_sdf(subject.robot, rendered.files[rendered.main])


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
    for name, value in zip(_MOMENTS, full[_UPPER[0], _UPPER[1]], strict=True):
        SubElement(inertia, name).text = number_text(value)


def _write_joint(model: Element, joint: Joint, tree: Tree) -> None:
    element = SubElement(model, "joint", name=joint.name, type="prismatic" if joint.slides else "revolute")
    SubElement(element, "pose", relative_to=tree.bodies[joint.parent].name).text = _format_pose(
        joint.placement
    )
    SubElement(element, "parent").text = tree.bodies[joint.parent].name
    SubElement(element, "child").text = tree.bodies[joint.child].name
    axis = SubElement(element, "axis")
    SubElement(axis, "xyz").text = number_text(*joint.axis)
    limit = SubElement(axis, "limit")
    SubElement(limit, "lower").text, SubElement(limit, "upper").text = (number_text(v) for v in joint.range)
    SubElement(limit, "effort").text = number_text(joint.servo.get("torque_limit", np.inf))
    SubElement(limit, "velocity").text = number_text(joint.servo.get("velocity_limit", np.inf))
    dynamics = SubElement(axis, "dynamics")
    SubElement(dynamics, "damping").text = number_text(joint.terms["viscous"])
    SubElement(dynamics, "friction").text = number_text(joint.terms["coulomb"])


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


# SDF as a simulator reads it: links, joints and what they say, with the format's own defaults.

# What SDF takes for a link that says nothing of its inertia.
_MASS, _MOMENT = 1.0, 1.0


def read_sdf(robot: Robot, text: bytes) -> LoadedTree:
    """The one model of an SDF text; raises InputError where it is none that this reads."""
    model = fromstring(text).find("model")
    if model is None:
        raise InputError("holds no model", source="written model")
    bodies = {str(link.get("name")): _read_body(link) for link in model.findall("link")}
    elements = {str(joint.get("name")): joint for joint in model.findall("joint")}
    poses = {str(link.get("name")): link.find("pose") for link in model.findall("link")}
    joints = [_read_joint(name, element, poses) for name, element in elements.items()]
    own = [elements[name] for name in robot.joint_names]
    return LoadedTree(
        robot,
        bodies,
        joints,
        {
            "viscous": _read_joint_numbers(own, "axis/dynamics/damping"),
            "coulomb": _read_joint_numbers(own, "axis/dynamics/friction"),
        },
        {
            "torque_limit": _read_joint_numbers(own, "axis/limit/effort"),
            "velocity_limit": _read_joint_numbers(own, "axis/limit/velocity"),
        },
    )


def _read_body(link: Element) -> ReadBody:
    inertial = link.find("inertial")
    if inertial is None:
        return ReadBody(_MASS, np.zeros(3), _MOMENT * np.eye(3))
    at = _read_pose(inertial.find("pose"))
    xx, xy, xz, yy, yz, zz = (
        float(inertial.findtext(f"inertia/{name}", "1" if name[1] == name[2] else "0"))
        for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    mass = float(inertial.findtext("mass", "1"))
    return ReadBody(mass, at.translation, at.rotation @ moments @ at.rotation.T)


def _read_joint(name: str, element: Element, poses: dict[str, Element | None]) -> ReadJoint:
    parent, child = element.findtext("parent", ""), element.findtext("child", "")
    pose, own = element.find("pose"), poses[child]
    outer = "" if parent == "world" else parent
    if pose is not None and pose.get("relative_to") == parent:
        in_parent = _read_pose(pose)
    elif pose is None and element.get("type") == "fixed":
        in_parent = pin.SE3.Identity()
    else:
        raise InputError(f"joint {name!r} says nothing of where it is", source="written model")
    in_child = pin.SE3.Identity()
    if own is not None and own.get("relative_to") == name:
        in_child = _read_pose(own).inverse()
    xyz = element.findtext("axis/xyz")
    axis = None if xyz is None else np.array([float(word) for word in xyz.split()])
    return ReadJoint(name, str(element.get("type")), outer, child, in_parent, in_child, axis)


def _read_pose(element: Element | None) -> pin.SE3:
    if element is None or not element.text:
        return pin.SE3.Identity()
    x, y, z, roll, pitch, yaw = (float(word) for word in element.text.split())
    return pin.SE3(pin.rpy.rpyToMatrix(roll, pitch, yaw), np.array([x, y, z]))


def _read_joint_numbers(joints: list[Element], path: str) -> Array:
    return np.array([float(joint.findtext(path, "nan")) for joint in joints])
