"""SDF as a simulator reads it: links, joints and what they say, with the format's own defaults."""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin
from defusedxml.ElementTree import fromstring

from excite.arrays import Array
from excite.errors import InputError
from excite.export.simulators.tree.read import LoadedTree, ReadBody, ReadJoint
from excite.robot.robot import Robot

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
