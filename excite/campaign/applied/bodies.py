"""A URDF whose links have bodies more than its author knew of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.arrays import Array

_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_UPPER = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])


# Share of a body's second moments that rounding may leave below zero, as where all its mass lies in a plane.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Loaded:
    """A URDF with bodies more.

    Attributes:
        urdf: its text.
        raised: links whose moments of inertia, as found, no body has; they got the nearest that one can have.
    """

    urdf: str
    raised: tuple[str, ...]


def with_bodies(urdf: str, bodies: Mapping[str, Array]) -> Loaded:
    """A URDF whose links have bodies more, ``(10,)`` about the link's frame each.

    Mass and its centre, which gravity tells far better than any moment of inertia, are as found.
    """
    raised: list[str] = []
    root = ElementTree.fromstring(urdf)
    for link in root.findall("link"):
        body = bodies.get(str(link.get("name")))
        if body is None:
            continue
        inertial = link.find("inertial")
        total = body if inertial is None else body + _stated_parameters(inertial)
        if inertial is not None:
            link.remove(inertial)
        found = pin.Inertia.FromDynamicParameters(total)
        there = _nearest_existing_body(found)
        raised += [] if there is found else [str(link.get("name"))]
        link.insert(0, _build_inertial(there))
    return Loaded(ElementTree.tostring(root, encoding="unicode"), tuple(raised))


def _nearest_existing_body(body: pin.Inertia) -> pin.Inertia:
    """The body itself, or that of the nearest second moments ``½ tr(I) 1 − I`` about its centre that mass can have.

    None of these is negative (Wensing, Kim and Slotine 2018, section III); of matrices without a negative eigenvalue
    the nearest one, in the sum of squares, has those of this one raised to zero (Higham 1988).
    """
    inertia = np.asarray(body.inertia)
    values, vectors = np.linalg.eigh(0.5 * np.trace(inertia) * np.eye(3) - inertia)
    if values[0] >= -_ROUNDING * np.abs(values).max():
        return body
    second = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return pin.Inertia(body.mass, body.lever, np.trace(second) * np.eye(3) - second)


def _stated_parameters(inertial: ElementTree.Element) -> Array:
    """Ten parameters about the link's frame that an inertial states."""
    origin, mass, moments = (inertial.find(name) for name in ("origin", "mass", "inertia"))
    xyz = _read_numbers(origin, "xyz")
    turn = pin.rpy.rpyToMatrix(*_read_numbers(origin, "rpy"))
    upper = [float(moments.get(name, "0")) if moments is not None else 0.0 for name in _MOMENTS]
    matrix = np.zeros((3, 3))
    matrix[_UPPER] = upper
    matrix = matrix + np.triu(matrix, 1).T
    kilograms = float(mass.get("value", "0")) if mass is not None else 0.0
    return np.asarray(pin.Inertia(kilograms, xyz, turn @ matrix @ turn.T).toDynamicParameters())


def _read_numbers(origin: ElementTree.Element | None, name: str) -> Array:
    text = "0 0 0" if origin is None else origin.get(name, "0 0 0")
    return np.array([float(part) for part in text.split()])


def _build_inertial(body: pin.Inertia) -> ElementTree.Element:
    inertial = ElementTree.Element("inertial")
    ElementTree.SubElement(inertial, "origin", xyz=" ".join(repr(float(x)) for x in body.lever), rpy="0 0 0")
    ElementTree.SubElement(inertial, "mass", value=repr(float(body.mass)))
    values = zip(_MOMENTS, np.asarray(body.inertia)[_UPPER], strict=True)
    ElementTree.SubElement(inertial, "inertia", {name: repr(float(v)) for name, v in values})
    return inertial
