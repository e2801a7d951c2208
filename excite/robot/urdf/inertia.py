"""Inertials of a URDF: every body that moves has mass, and no body is impossible."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.errors import RobotError
from excite.formats.documents import all_alike
from excite.robot.refusal import robot_error
from excite.robot.urdf.numbers import read_numbers

TOLERANCE = 1e-6
"""How far, relative to the largest principal moment, a moment may break the triangle inequality."""

MAX_GYRATION = 20.0
"""Largest radius of gyration of a link [m].

Twice what the most careless of 1181 published models has, which put in moments of 1 or 100 for want of better; the
boom of a crane, 60 m, has 17. Moments in kg·mm² make it a thousand times what it is.
"""

# A link of less than this share of the robot's mass stands for a frame, as that of an iiwa's flange with 1e-6 kg and
# moments of 1 kg·m² does: they were put in for want of better, and say nothing of the file's units.
WEIGHTLESS = 1e-3

MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


@dataclass(frozen=True, eq=False)
class Inertial:
    """A link's ``<inertial>``.

    Attributes:
        mass: [kg]
        centre: of mass, in the link's frame ``(3,)`` [m].
        moments: about the centre of mass, along the link's axes ``(3, 3)`` [kg·m²].
    """

    mass: float
    centre: NDArray[np.float64]
    moments: NDArray[np.float64]

    @property
    def size(self) -> float:
        """Largest of the moments and products of inertia, without its sign [kg·m²]."""
        return float(np.abs(self.moments).max())


def check_inertials(
    root: ElementTree.Element,
    joints: dict[str, ElementTree.Element],
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
    root: ElementTree.Element, joints: dict[str, ElementTree.Element], floating: bool, path: Path
) -> dict[str, RobotError]:
    """Links whose inertial is missing or impossible and may be acknowledged, with the error each would raise.

    Arguments as for :func:`check_inertials`.

    Raises:
        RobotError: a fault that cannot be acknowledged: a number that is none, negative mass, moments in another unit.
    """
    inertials = {link.get("name", ""): read_inertial(link, path) for link in root.findall("link")}
    known = [one for one in inertials.values() if one is not None]
    weightless = WEIGHTLESS * sum(one.mass for one in known)
    # Frames that an exporter gave a mass of next to nothing may have any moments that are next to nothing.
    least = TOLERANCE * max((one.size for one in known), default=0.0)
    faults: dict[str, RobotError] = {}
    for name, inertial in inertials.items():
        spread = None if inertial is None else _describe_spread(inertial, least)
        fault = None if inertial is None else spread or _describe_impossible(inertial.moments, strict=False)
        if spread and inertial is not None and inertial.mass > weightless:
            field, remedy = f"link {name!r}/inertial/inertia", "write moments in kg·m² and masses in kg"
            raise robot_error(path, field, spread, remedy)
        if inertial is not None and inertial.mass == 0.0:
            remedy = _inertial_remedy(name, "give a positive mass in kilograms")
            where = f"link {name!r}/inertial/mass@value"
            faults[name] = robot_error(path, where, "is 0 and the moments are not", remedy)
        elif fault:
            remedy = _inertial_remedy(name, "correct the moments")
            faults[name] = robot_error(path, f"link {name!r}/inertial/inertia", fault, remedy)
    for name, members in _moving_bodies(inertials, joints, floating).items():
        fault = _body_fault([inertials[member] for member in members])
        if fault and not faults.keys() & set(members):
            remedy = _inertial_remedy(name, "give the link an <inertial> with mass and moments")
            faults[name] = robot_error(path, f"link {name!r}/inertial", fault, remedy)
    return faults


def resting_faults(
    root: ElementTree.Element, joints: dict[str, ElementTree.Element], path: Path
) -> tuple[str, ...]:
    """Links with an impossible inertial that no joint moves on a fixed base: their inertia acts on nothing.

    Arguments as for :func:`check_inertials`.
    """
    inertials = {link.get("name", ""): read_inertial(link, path) for link in root.findall("link")}
    moved = {
        name for members in _moving_bodies(inertials, joints, floating=False).values() for name in members
    }
    return tuple(name for name in inertial_faults(root, joints, False, path) if name not in moved)


def _inertial_remedy(link: str, mend: str) -> str:
    return f"{mend}, or acknowledge it under model.acknowledged.{link} in robot.yaml with the reason"


def read_inertial(link: ElementTree.Element, path: Path) -> Inertial | None:
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
    (mass,) = read_numbers(mass_element, "value", 1, path, f"{where}/mass")
    origin = elements[0].find("origin")
    pose = ElementTree.Element("origin") if origin is None else origin
    centre, rpy = (
        read_numbers(pose, key, 3, path, f"{where}/origin", default="0 0 0") for key in ("xyz", "rpy")
    )
    values = [read_numbers(inertia, key, 1, path, f"{where}/inertia")[0] for key in MOMENTS]
    if mass < 0.0:
        remedy = "give a positive mass in kilograms"
        raise robot_error(path, f"{where}/mass@value", f"is {mass}", remedy)
    rotation = pin.rpy.rpyToMatrix(*rpy)
    # A frame: mass and moments all zero.
    if mass == 0.0 and not any(values):
        return None
    return Inertial(mass, np.array(centre), rotation @ symmetric_matrix(values) @ rotation.T)


def symmetric_matrix(six: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Symmetric matrix of ixx, ixy, ixz, iyy, iyz, izz."""
    return np.asarray(six)[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


def _describe_spread(inertial: Inertial, least: float) -> str | None:
    """How far a body reaches that is larger than any is, in words; None where it is not, or has ``least`` moments."""
    if inertial.mass <= 0.0 or inertial.size <= least:
        return None
    radius = math.sqrt(inertial.size / inertial.mass)
    return f"spreads {inertial.mass:g} kg over a radius of {radius:.3g} m" if radius > MAX_GYRATION else None


def _describe_impossible(moments: NDArray[np.float64], *, strict: bool) -> str | None:
    """What is wrong with moments about the CoM, in words; None if nothing is."""
    low, middle, high = (float(value) for value in np.linalg.eigvalsh(moments))
    if low < -TOLERANCE * max(high, 0.0) or high < 0.0 or (strict and low <= 0.0):
        return f"is not positive definite (smallest principal moment {low:.3g})"
    if low + middle < high * (1.0 - TOLERANCE):
        return f"breaks the triangle inequality ({low:.3g} + {middle:.3g} < {high:.3g})"
    return None


def _moving_bodies(
    inertials: dict[str, Inertial | None], joints: dict[str, ElementTree.Element], floating: bool
) -> dict[str, list[str]]:
    """Links of each moving rigid body, by the link that its joint carries."""
    fixed: dict[str, str] = {}
    moving: set[str] = set()
    for joint in joints.values():
        parent, child = (str(joint.find(end).get("link")) for end in ("parent", "child"))  # type: ignore[union-attr]
        if joint.get("type") == "fixed":
            fixed[child] = parent
        else:
            moving.add(child)
    members: dict[str, list[str]] = {}
    for link in inertials:
        head = link
        while head in fixed:
            head = fixed[head]
        if floating or head in moving:
            members.setdefault(head, []).append(link)
    return members


def _body_fault(parts: list[Inertial | None]) -> str | None:
    """Whether links that move as one body have mass and positive moments together.

    Where the links' own orientations would matter, the parts are taken one by one: several links with mass
    always sum to a possible body when each is possible, and a fixed pair of point masses is accepted.
    """
    solid = [part for part in parts if part is not None]
    if not solid:
        return "moves and has no mass"
    if len(solid) == 1:
        return _describe_impossible(solid[0].moments, strict=True)
    return None


# Collision and visual geometry of a URDF: places and sizes that something can have.

# Attributes of solids that are lengths or factors, how many numbers each holds, and its default.
_LENGTHS: dict[str, tuple[tuple[str, int, str | None], ...]] = {
    "box": (("size", 3, None),),
    "sphere": (("radius", 1, None),),
    "cylinder": (("radius", 1, None), ("length", 1, None)),
    "capsule": (("radius", 1, None), ("length", 1, None)),
    "mesh": (("scale", 3, "1 1 1"),),
}


def check_origin(element: ElementTree.Element, where: str, path: Path) -> None:
    """Raise RobotError unless the element's ``origin``, if it has one, holds positions and angles."""
    origin = element.find("origin")
    if origin is not None:
        for attribute in ("xyz", "rpy"):
            read_numbers(origin, attribute, 3, path, f"{where}/origin", default="0 0 0")


def check_geometry(link: ElementTree.Element, name: str, path: Path) -> None:
    """Raise RobotError unless the solids of a link have places and sizes."""
    for kind in ("collision", "visual"):
        for number, element in enumerate(link.findall(kind)):
            where = f"link {name!r}/{kind} {number}"
            check_origin(element, where, path)
            for solid in element.iterfind("geometry/*"):
                _check_solid(solid, where, path)


def drop_points(root: ElementTree.Element) -> None:
    """Take out solids all of whose lengths are zero, which stand for none in many models: they take no room.

    A link that is left without geometry is named where a first description says what nothing checks.
    """
    for link in root.findall("link"):
        for kind in ("collision", "visual"):
            for element in link.findall(kind):
                if any(_is_point(solid) for solid in element.iterfind("geometry/*")):
                    link.remove(element)


def _is_point(solid: ElementTree.Element) -> bool:
    lengths = " ".join(solid.get(attribute, "none") for attribute, _, _ in _LENGTHS.get(solid.tag, ()))
    try:
        return solid.tag != "mesh" and lengths != "" and not any(float(length) for length in lengths.split())
    except ValueError:
        return False


def _check_solid(solid: ElementTree.Element, where: str, path: Path) -> None:
    where = f"{where}/{solid.tag}"
    if solid.tag == "mesh" and not solid.get("filename", "").strip():
        raise robot_error(path, f"{where}@filename", "is missing", "name the mesh file")
    for attribute, count, default in _LENGTHS.get(solid.tag, ()):
        values = read_numbers(solid, attribute, count, path, where, default=default)
        # A mesh may be mirrored by a negative scale, and scaled to nothing by none.
        if any(value == 0.0 if solid.tag == "mesh" else value <= 0.0 for value in values):
            what = f"is {solid.get(attribute)!r}"
            raise robot_error(path, f"{where}@{attribute}", what, "give lengths above 0")


# Whether a model's masses can be kilograms: grams give bodies that no material has and no drive could lift.

# Half of each known robot's mass (66 models) lies in bodies below 21 000 kg/m³ by their own inertia, and mostly
# below 5 000; the densest metal has 22 600. Grams make 4e5 of the usual 400.
MAX_DENSITY = 1e5
# The weight of known robots' limbs is at most twice what the drives there can hold; grams make a thousand times.
MAX_WEIGHT = 30.0
# Thinner bodies are points and lines, which models use where inertia does not matter [m].
_THINNEST = 1e-3
_GRAVITY = 9.81


def check_weights(model: pin.Model, torque: NDArray[np.float64], path: Path) -> None:
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
    if density <= MAX_DENSITY:
        return
    weight = _joint_loads(model)[-len(torque) :]
    known = np.isfinite(torque) & (torque > 0.0)
    share = float((weight[known] / torque[known]).max(initial=0.0))
    if share > MAX_WEIGHT:
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
            half_axes = np.sqrt(np.maximum(squares, _THINNEST**2))
            mass.append(inertia.mass)
            volume.append(4.0 / 3.0 * np.pi * half_axes.prod())
    if not mass:
        return 0.0
    masses, density = np.array(mass), np.array(mass) / np.array(volume)
    order = np.argsort(density, kind="stable")
    below = np.cumsum(masses[order])
    return float(density[order][np.searchsorted(below, 0.5 * below[-1])])


def _joint_loads(model: pin.Model) -> NDArray[np.float64]:
    """Torque or force with which the weight beyond each joint can load it, about, by joint [N·m or N]."""
    data = model.createData()
    pin.centerOfMass(model, data, pin.neutral(model))
    loads = []
    for joint in range(1, model.njoints):
        lever = 1.0 if "Prismatic" in model.joints[joint].shortname() else np.linalg.norm(data.com[joint])
        loads.append(data.mass[joint] * _GRAVITY * lever)
    return np.array(loads)
