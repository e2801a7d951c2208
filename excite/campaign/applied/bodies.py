"""A URDF whose links have bodies more than its author knew of."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.arrays import Array

_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_UPPER = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])


def with_bodies(urdf: str, bodies: Mapping[str, Array]) -> str:
    """A URDF whose links have bodies more, ``(10,)`` about the link's frame each."""
    root = ElementTree.fromstring(urdf)
    for link in root.findall("link"):
        body = bodies.get(str(link.get("name")))
        if body is None:
            continue
        inertial = link.find("inertial")
        total = body if inertial is None else body + _stated(inertial)
        if inertial is not None:
            link.remove(inertial)
        link.insert(0, _inertial(pin.Inertia.FromDynamicParameters(total)))
    return ElementTree.tostring(root, encoding="unicode")


def _stated(inertial: ElementTree.Element) -> Array:
    """Ten parameters about the link's frame that an inertial states."""
    origin, mass, moments = (inertial.find(name) for name in ("origin", "mass", "inertia"))
    xyz = _numbers(origin, "xyz")
    turn = pin.rpy.rpyToMatrix(*_numbers(origin, "rpy"))
    upper = [float(moments.get(name, "0")) if moments is not None else 0.0 for name in _MOMENTS]
    matrix = np.zeros((3, 3))
    matrix[_UPPER] = upper
    matrix = matrix + np.triu(matrix, 1).T
    kilograms = float(mass.get("value", "0")) if mass is not None else 0.0
    return np.asarray(pin.Inertia(kilograms, xyz, turn @ matrix @ turn.T).toDynamicParameters())


def _numbers(origin: ElementTree.Element | None, name: str) -> Array:
    text = "0 0 0" if origin is None else origin.get(name, "0 0 0")
    return np.array([float(part) for part in text.split()])


def _inertial(body: pin.Inertia) -> ElementTree.Element:
    inertial = ElementTree.Element("inertial")
    ElementTree.SubElement(inertial, "origin", xyz=" ".join(repr(float(x)) for x in body.lever), rpy="0 0 0")
    ElementTree.SubElement(inertial, "mass", value=repr(float(body.mass)))
    values = zip(_MOMENTS, np.asarray(body.inertia)[_UPPER], strict=True)
    ElementTree.SubElement(inertial, "inertia", {name: repr(float(v)) for name, v in values})
    return inertial
