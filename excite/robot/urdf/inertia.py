"""Inertials of a URDF: every body that moves has mass, and no body is impossible."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import RobotError
from excite.formats.documents import all_alike
from excite.robot.refusal import robot_error
from excite.robot.urdf.numbers import read_number, read_numbers, read_origin
from excite.robot.urdf.writing import MOMENTS

TOLERANCE = 1e-6
"""How far, relative to the largest principal moment, a moment may break the triangle inequality."""


# A link of less than this share of the robot's mass stands for a frame, as that of an iiwa's flange with 1e-6 kg and
# moments of 1 kg·m² does: they were put in for want of better, and say nothing of the file's units.
WEIGHTLESS = 1e-3


@dataclass(frozen=True, eq=False)
class Inertial:
    """A link's ``<inertial>``.

    Attributes:
        mass: [kg]; 0 where nothing is stated.
        centre: of mass, in the link's frame ``(3,)`` [m].
        stated: ixx, ixy, ixz, iyy, iyz, izz as written, along the inertial's own axes ``(6,)`` [kg·m²].
        axes: the inertial's axes in the link's frame, ``(3, 3)``.
    """

    mass: float = 0.0
    centre: Array = field(default_factory=lambda: np.zeros(3))
    stated: Array = field(default_factory=lambda: np.zeros(6))
    axes: Array = field(default_factory=lambda: np.eye(3))

    @property
    def moments(self) -> Array:
        """About the centre of mass, along the link's axes ``(3, 3)`` [kg·m²]."""
        return self.axes @ symmetric_matrix(self.stated) @ self.axes.T

    @property
    def size(self) -> float:
        """Largest of the moments and products of inertia, without its sign [kg·m²]."""
        return float(np.abs(self.moments).max())

    @property
    def ten_parameters(self) -> Array:
        """Ten parameters about the link's frame, in pinocchio's order, ``(10,)``."""
        return np.asarray(pin.Inertia(self.mass, self.centre, self.moments).toDynamicParameters())


def check_inertials(
    root: Element,
    joints: dict[str, Element],
    floating: bool,
    acknowledged: Mapping[str, str],
    path: Path,
) -> None:
    """Check the inertial of every link, and that every rigid body that moves has mass and inertia.

    A link without mass is a frame: allowed where it is fixed to a link that has mass. Principal moments
    about the CoM must not be negative and must obey the triangle inequality, with equality allowed on
    links of a larger body; the moments of each whole moving body must be positive.

    Args:
        root: the ``robot`` element.
        joints: its joints by name, locked ones already fixed.
        floating: whether the root body moves.
        acknowledged: links whose fault ``robot.yaml`` accepts, with the reason.
        path: file, for the error.

    Raises:
        RobotError: names the link and what to do.
    """
    faults = inertial_faults(root, joints, floating, path)
    for name, error in faults.items():
        if name not in acknowledged:
            raise error
    for name in acknowledged:
        if name not in faults:
            raise robot_error(
                path,
                f"link {name!r}",
                "needs no acknowledgement: its inertia is sound or it does not exist",
                "remove it from model.acknowledged in robot.yaml",
            )


def inertial_faults(
    root: Element, joints: dict[str, Element], floating: bool, path: Path
) -> dict[str, RobotError]:
    """Links whose inertial is missing or impossible and may be acknowledged, with the error each would raise.

    Arguments as for :func:`check_inertials`.

    Raises:
        RobotError: a fault that cannot be acknowledged: a number that is none, negative mass, moments in another unit.
    """
    known = _known_inertials(root, path)
    weightless = WEIGHTLESS * sum(one.mass for one in known.values())
    # Frames that an exporter gave a mass of next to nothing may have any moments that are next to nothing.
    least = TOLERANCE * max((one.size for one in known.values()), default=0.0)
    faults: dict[str, RobotError] = {}

    def find_fault(name: str, place: str, what: str, mend: str) -> None:
        remedy = f"{mend}, or acknowledge it under model.acknowledged.{name} in robot.yaml with the reason"
        faults[name] = robot_error(path, f"link {name!r}/inertial{place}", what, remedy)

    for name, inertial in known.items():
        # The radius over which the mass is spread.
        radius = math.sqrt(inertial.size / inertial.mass) if inertial.mass and inertial.size > least else 0.0
        fault = _describe_impossible(inertial.moments, strict=False)
        # Largest radius of gyration of a link [m]. Twice what the most careless of 1181 published models has, which put
        # in moments of 1 or 100 for want of better; the boom of a crane, 60 m, has 17. Moments in kg·mm² make it a
        # thousand times what it is.
        if radius > 20.0:
            fault = f"spreads {inertial.mass:g} kg over a radius of {radius:.3g} m"
            if inertial.mass > weightless:
                remedy = "write moments in kg·m² and masses in kg"
                raise robot_error(path, f"link {name!r}/inertial/inertia", fault, remedy)
        if inertial.mass == 0.0:
            find_fault(
                name, "/mass@value", "is 0 and the moments are not", "give a positive mass in kilograms"
            )
        elif fault:
            find_fault(name, "/inertia", fault, "correct the moments")
    for name, members in _moving_bodies(root, joints, floating).items():
        # Several possible parts with mass are a possible body; a fixed pair of point masses is accepted.
        solid = [known[member] for member in members if member in known]
        fault = None if solid else "moves and has no mass"
        if len(solid) == 1:
            fault = _describe_impossible(solid[0].moments, strict=True)
        if fault and not faults.keys() & set(members):
            find_fault(name, "", fault, "give the link an <inertial> with mass and moments")
    return faults


def _known_inertials(root: Element, path: Path) -> dict[str, Inertial]:
    """Inertials by link, of links that state one; raises RobotError for negative mass."""
    found = {}
    for link in root.findall("link"):
        name, inertial = link.get("name", ""), read_inertial(link, path)
        if inertial is not None:
            found[name] = inertial
            if inertial.mass < 0.0:
                what, remedy = f"is {inertial.mass}", "give a positive mass in kilograms"
                raise robot_error(path, f"link {name!r}/inertial/mass@value", what, remedy)
    return found


def resting_faults(root: Element, joints: dict[str, Element], path: Path) -> tuple[str, ...]:
    """Links with an impossible inertial that no joint moves on a fixed base: their inertia acts on nothing.

    Arguments as for :func:`check_inertials`.
    """
    links = [link.get("name", "") for link in root.findall("link")]
    moved = itertools.chain.from_iterable(_moving_bodies(root, joints, floating=False).values())
    return tuple(sorted(inertial_faults(root, joints, False, path).keys() - set(moved), key=links.index))


def read_inertial(link: Element, path: Path) -> Inertial | None:
    """What a link says of its mass; None where it says nothing or is a frame without any; raises RobotError."""
    elements = link.findall("inertial")
    where = f"link {link.get('name')!r}/inertial"
    if not elements:
        return None
    if not all_alike(elements):
        raise robot_error(path, where, "occurs twice", "keep one")
    mass_element, inertia = elements[0].find("mass"), elements[0].find("inertia")
    if mass_element is None:
        raise robot_error(path, where, "has no <mass>", "give the mass in kilograms")
    if inertia is None:
        raise robot_error(path, where, "has no <inertia>", "give the moments about the CoM")
    mass = read_number(mass_element, "value", path, f"{where}/mass")
    pose = read_origin(elements[0], path, where)
    values = [read_number(inertia, key, path, f"{where}/inertia") for key in MOMENTS]
    # A frame: mass and moments all zero.
    if mass == 0.0 and not any(values):
        return None
    return Inertial(mass, pose.translation.copy(), np.array(values), pose.rotation.copy())


def symmetric_matrix(six: Sequence[float] | Array) -> Array:
    """Symmetric matrix of ixx, ixy, ixz, iyy, iyz, izz."""
    return np.asarray(six)[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


def moments_fault(principal: NDArray[np.floating]) -> Literal["not_positive", "triangle", ""]:
    """Why no body has principal moments about its centre, ``(3,)`` in rising order; empty where one may."""
    low, middle, high = principal
    if low < -TOLERANCE * max(high, 0.0) or high < 0.0:
        return "not_positive"
    return "triangle" if low + middle < high * (1.0 - TOLERANCE) else ""


def _describe_impossible(moments: Array, *, strict: bool) -> str | None:
    """What is wrong with moments about the CoM, in words; None if nothing is."""
    principal = np.linalg.eigvalsh(moments)
    (low, middle, high), fault = principal, moments_fault(principal)
    if fault == "not_positive" or (strict and low <= 0.0):
        return f"is not positive definite (smallest principal moment {low:.3g})"
    if fault:
        return f"breaks the triangle inequality ({low:.3g} + {middle:.3g} < {high:.3g})"
    return None


def _moving_bodies(root: Element, joints: dict[str, Element], floating: bool) -> dict[str, list[str]]:
    """Links of each moving rigid body, by the link that its joint carries."""
    carriers = {joint.find("child").get("link"): joint for joint in joints.values()}  # type: ignore[union-attr]
    members: dict[str, list[str]] = {}
    for link in (one.get("name", "") for one in root.findall("link")):
        head = link
        while head in carriers and carriers[head].get("type") == "fixed":
            head = carriers[head].find("parent").get("link")  # type: ignore[union-attr,assignment]
        if floating or head in carriers:
            members.setdefault(head, []).append(link)
    return members


# Collision and visual geometry of a URDF: places and sizes that something can have.

GEOMETRY = ("collision", "visual")
# Attributes of solids that are lengths or factors, how many numbers each holds, and its default.
LENGTHS: dict[str, tuple[tuple[str, int, str | None], ...]] = {
    "box": (("size", 3, None),),
    "sphere": (("radius", 1, None),),
    "cylinder": (("radius", 1, None), ("length", 1, None)),
    "capsule": (("radius", 1, None), ("length", 1, None)),
    "mesh": (("scale", 3, "1 1 1"),),
}


def check_geometry(link: Element, name: str, path: Path) -> None:
    """Raise RobotError unless the solids of a link have places and sizes."""
    for kind in GEOMETRY:
        for number, element in enumerate(link.findall(kind)):
            where = f"link {name!r}/{kind} {number}"
            read_origin(element, path, where)
            for solid in element.iterfind("geometry/*"):
                _check_solid(solid, where, path)


def drop_points(root: Element) -> None:
    """Take out solids all of whose lengths are zero, which stand for none in many models: they take no room.

    A link that is left without geometry is named where a first description says what nothing checks.
    """
    for link in root.findall("link"):
        for element in [one for kind in GEOMETRY for one in link.findall(kind)]:
            if any(_is_point(solid) for solid in element.iterfind("geometry/*")):
                link.remove(element)


def _is_point(solid: Element) -> bool:
    lengths = " ".join(solid.get(attribute, "none") for attribute, _, _ in LENGTHS.get(solid.tag, ()))
    try:
        return solid.tag != "mesh" and lengths != "" and not any(float(length) for length in lengths.split())
    except ValueError:
        return False


def _check_solid(solid: Element, where: str, path: Path) -> None:
    where = f"{where}/{solid.tag}"
    if solid.tag == "mesh" and not solid.get("filename", "").strip():
        raise robot_error(path, f"{where}@filename", "is missing", "name the mesh file")
    for attribute, count, default in LENGTHS.get(solid.tag, ()):
        values = read_numbers(solid, attribute, count, path, where, default=default)
        # A mesh may be mirrored by a negative scale, and scaled to nothing by none.
        if any(value == 0.0 if solid.tag == "mesh" else value <= 0.0 for value in values):
            what = f"is {solid.get(attribute)!r}"
            raise robot_error(path, f"{where}@{attribute}", what, "give lengths above 0")


# Whether a model's masses can be kilograms: grams give bodies that no material has and no drive could lift.


def check_weights(model: pin.Model, torque: Array, path: Path) -> None:
    """Refuse a model whose masses are in grams.

    Two things have to speak for it: bodies denser than any metal, from their mass and moments, and weight far
    beyond the drives' torque.

    Args:
        model: model of the robot.
        torque: limits of the actuated joints, the model's last; 0 or NaN where unknown [N·m or N].
        path: file of the model, for the error.

    Raises:
        RobotError: the masses cannot be kilograms.
    """
    density = typical_density(model)
    # Half of each known robot's mass (66 models) lies in bodies below 21 000 kg/m³ by their own inertia, and mostly
    # below 5 000; the densest metal has 22 600. Grams make 4e5 of the usual 400.
    if density <= 1e5:
        return
    # The torque or force with which the weight beyond each joint can load it, about.
    data = model.createData()
    pin.centerOfMass(model, data, pin.neutral(model))
    slides = np.array(["Prismatic" in joint.shortname() for joint in list(model.joints)[1:]])
    levers = np.where(slides, 1.0, np.linalg.norm(np.array(list(data.com)[1:]), axis=1))
    weight = (9.81 * np.array(list(data.mass)[1:]) * levers)[-len(torque) :]
    known = np.isfinite(torque) & (torque > 0.0)
    share = float((weight[known] / torque[known]).max(initial=0.0))
    # The weight of known robots' limbs is at most twice what the drives there can hold; grams make a thousand times.
    if share > 30.0:
        raise robot_error(
            path,
            "mass@value",
            f"its bodies have {density:.2g} kg/m³ by their moments of inertia and weigh {share:.2g} times what its"
            " drives can hold",
            "looks like grams: write masses in kg and moments of inertia in kg·m²",
        )


def typical_density(model: pin.Model) -> float:
    """Density above which half of the mass lies, each body taken for the ellipsoid of its moments [kg/m³].

    Points without moments have none; 0 where there is nothing else.
    """
    mass, volume = [], []
    for inertia in list(model.inertias)[1:]:
        moments = np.linalg.eigvalsh(inertia.inertia)
        if inertia.mass > 0.0 and moments.any():
            squares = 2.5 * (moments.sum() - 2.0 * moments) / inertia.mass
            # Thinner bodies are points and lines, which models use where inertia does not matter [m].
            half_axes = np.sqrt(np.maximum(squares, 1e-3**2))
            mass.append(inertia.mass)
            volume.append(4.0 / 3.0 * np.pi * half_axes.prod())
    if not mass:
        return 0.0
    masses, density = np.array(mass), np.array(mass) / np.array(volume)
    order = np.argsort(density, kind="stable")
    below = np.cumsum(masses[order])
    return float(density[order][np.searchsorted(below, 0.5 * below[-1])])
