"""What the file of a model states beside the URDF made from it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from excite.data_tables import read_rows
from excite.errors import RobotError
from excite.results import Assumed
from excite.robot.init_robot.assumptions import assume
from excite.robot.shapes.link_shapes import solid_shape
from excite.robot.shapes.mesh_files import read_meshes
from excite.robot.shapes.shape import coal_geometry
from excite.robot.shapes.stand_ins import DENSITY
from excite.robot.urdf.inertia import GEOMETRY
from excite.robot.urdf.numbers import read_origin
from excite.robot.urdf.reading import find_mesh
from excite.robot.urdf.writing import MOMENTS, add_element

_WORDS = {"arm", "kind", "model"}

# Masses in place of those that a model does not state: its links' geometry at the density of robots.


def weigh_links(root: Element, path: Path) -> tuple[Assumed | None, dict[str, Any]]:
    """Give a URDF masses from its geometry; not where it states some, or has no geometry that can be read.

    Args:
        root: its ``robot`` element, which is given the inertials.
        path: the file, from which its meshes are found.

    Returns:
        What was assumed, None where nothing was, and how wide it is: a block ``uncertainty`` by the table of published
        arms.
    """
    masses = []
    for link in [] if states_mass(root) else root.findall("link"):
        inertia = _of_geometry(link, path)
        if inertia is None:
            continue
        for old in link.findall("inertial"):
            link.remove(old)
        made = add_element(link, "inertial")
        add_element(made, "origin", xyz=" ".join(f"{x:.6g}" for x in inertia.lever))
        add_element(made, "mass", value=f"{inertia.mass:.6g}")
        moments = (f"{x:.9g}" for x in inertia.inertia[np.triu_indices(3)])
        add_element(made, "inertia", **dict(zip(MOMENTS, moments, strict=True)))
        masses.append(inertia.mass)
    if not masses:
        return None, {}
    # Widths about bodies of one density by published_arms.csv; mass is the mean of a link so weighed [kg].
    # Size did not tell density there: a slope over hulls of 0.02 to 41 l took 2 % of its spread. Kinds differ in their
    # medians, 470 kg/m³ of servos and 1440 of cobots, by too few arms each for widths of their own. Centres and moments
    # are as far off as in the median arm, since in a set all of its bodies are so at once.
    rows = read_rows(__file__, "published_arms.csv")
    column = {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if name not in _WORDS}
    off = np.abs(1e3 * column["mass_kg"] / column["hull_litres"] / DENSITY - 1.0)
    wide = {
        "mass": float(np.quantile(off, _SHARE)),
        "com": float(np.median(column["com_share"]) * np.cbrt(float(np.mean(masses)) / DENSITY)),
        "inertia": float(np.median(column["inertia_share"])),
    }
    widths = {name: round(value, 3) for name, value in wide.items()} | {"source": "published arms"}
    told = {"mass": sum(masses), "density": DENSITY, "share": _SHARE, "width": widths["mass"]}
    return assume("masses", **told), widths


# Share of the published arms that the width of the mass holds.
_SHARE = 0.9


def states_mass(root: Element) -> bool:
    """Whether any link of a URDF has a mass, or what is no number in its place."""
    # What is none is refused, with its place, where inertials are checked.
    return any(link_mass(link, math.nan) != 0.0 for link in root.findall("link"))


def link_mass(link: Element, otherwise: float = 0.0) -> float:
    """A link's mass [kg], 0 without one; ``otherwise`` of what is no number."""
    mass = link.find("inertial/mass")
    try:
        return 0.0 if mass is None else float(mass.get("value", "0"))
    except ValueError:
        return otherwise


def _of_geometry(link: Element, path: Path) -> pin.Inertia | None:
    """Inertia of a link full of robot, in its own frame: of what it collides with, else of what is seen of it."""
    for kind in GEOMETRY:
        parts = [part for element in link.findall(kind) if (part := _of_element(element, path)) is not None]
        if parts:
            return sum(parts[1:], start=parts[0])
    return None


def _of_element(element: Element, path: Path) -> pin.Inertia | None:
    solid, points = next(element.iterfind("geometry/*"), None), None
    try:
        if solid is not None and solid.tag == "mesh":
            file = find_mesh(solid.get("filename", ""), path)
            points = None if file is None else read_meshes([file])[file]
        if solid is None or (solid.tag == "mesh" and points is None):
            return None
        body = coal_geometry(solid_shape(solid, points, path, "geometry"))
    except (RobotError, ValueError):
        # A description says what is wrong with geometry, where it is needed.
        return None
    mass = DENSITY * body.computeVolume()
    about = DENSITY * np.asarray(body.computeMomentofInertiaRelatedToCOM())
    own = pin.Inertia(mass, np.asarray(body.computeCOM()), about) if mass > 0.0 else None
    return None if own is None else read_origin(element).act(own)
