"""Elements of a URDF that is made here: joints, inertials, solids, and their numbers to the last bit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from excite.arrays import Array

MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
Value = str | float | Array | Sequence[float]


def number_text(*values: float) -> str:
    """Numbers as an attribute holds them, to the last bit; a zero has no sign."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def add_element(parent: Element, tag: str, /, **values: Value) -> Element:
    """An element below another one, with attributes of words, numbers and rows of numbers."""
    words = {k: v if isinstance(v, str) else number_text(*np.atleast_1d(v)) for k, v in values.items()}
    return SubElement(parent, tag, words)


def write_origin(element: Element, pose: pin.SE3) -> None:
    """Give an element an ``<origin>``."""
    add_element(element, "origin", xyz=pose.translation, rpy=pin.rpy.matrixToRpy(pose.rotation))


def add_joint(robot: Element, name: str, kind: str, parent: str, child: str, pose: pin.SE3) -> Element:
    """A joint of a type between two links, in the parent link's frame."""
    joint = SubElement(robot, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    write_origin(joint, pose)
    return joint


def add_inertial(link: Element, pose: pin.SE3, mass: Value, moments: Iterable[Value]) -> None:
    """Mass [kg] of a link, and its six moments in the order of :data:`MOMENTS` about its centre [kg·m²]."""
    inertial = SubElement(link, "inertial")
    write_origin(inertial, pose)
    add_element(inertial, "mass", value=mass)
    add_element(inertial, "inertia", **dict(zip(MOMENTS, moments, strict=True)))


def add_solid(link: Element, kind: str, pose: pin.SE3, tag: str, **sizes: Value) -> Element:
    """A solid of a link, one of its ``collision`` or ``visual`` elements: a tag and its sizes [m]."""
    element = SubElement(link, kind)
    write_origin(element, pose)
    return add_element(SubElement(element, "geometry"), tag, **sizes)
