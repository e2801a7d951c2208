"""Shapes of a link as its URDF gives them: boxes, spheres, cylinders, capsules, and hulls of meshes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import RobotError
from excite.robot.links import link_placement
from excite.robot.quantities import MAX_TRAVEL
from excite.robot.robot import Robot
from excite.robot.shapes.kept_hulls import kept_hull
from excite.robot.shapes.shape import Shape

# A hull of 96 corners may have to grow by a hundredth; of a smooth body the growth falls with the corners' square.
_CORNERS, _SLACK = 96, 0.01


def link_shapes(
    robot: Robot, link: ElementTree.Element, kind: str, points: Mapping[Path, Array]
) -> list[Shape]:
    """Shapes of a link from its elements of a kind (``collision`` or ``visual``); raises RobotError.

    ``points`` are the corners of the meshes, by file.
    """
    name = link.get("name", "")
    shapes = []
    for number, element in enumerate(link.findall(kind)):
        where = f"link {name!r}, {kind} {number}"
        joint, placement = link_placement(robot.model, name, robot.source, where)
        pose = placement * origin_of(element.find("origin"))
        geometry = element.find("geometry")
        solid = geometry[0] if geometry is not None and len(geometry) else None
        if solid is None:
            raise RobotError(
                "has no geometry", source=robot.source, field=where, remedy="remove or fill the element"
            )
        body = _Place(f"{name}_{number}", name, joint, pose, robot, where)
        shapes.append(_solid(body, solid, points))
    return shapes


@dataclass(frozen=True, eq=False)
class _Place:
    """Where a shape sits, and what to call it in errors.

    Attributes:
        name: of the shape.
        link: that it belongs to.
        joint: that carries it.
        pose: in that joint's frame.
        robot: the robot.
        where: the URDF's element, in words.
    """

    name: str
    link: str
    joint: int
    pose: pin.SE3
    robot: Robot
    where: str


def _solid(at: _Place, solid: ElementTree.Element, meshes: Mapping[Path, Array]) -> Shape:
    robot, where, placed = at.robot, at.where, (at.name, at.link, at.joint, at.pose)
    if solid.tag == "mesh":
        corners = robot.description.collision.hull_corners
        points = meshes[Path(solid.get("filename", ""))] * numbers_of(solid.get("scale", "1 1 1"))
        if np.abs(points).max() > MAX_TRAVEL:
            raise RobotError(
                f"its mesh reaches {np.abs(points).max():.3g} m from its origin",
                source=robot.source,
                field=where,
                remedy='looks like millimetres: write scale="0.001 0.001 0.001"',
            )
        try:
            hull = kept_hull(points, corners, _SLACK * (_CORNERS / corners) ** 2)
        except ValueError as error:
            raise RobotError(
                str(error), source=robot.source, field=where, remedy="author a shape instead"
            ) from error
        return Shape(*placed, "convex", (), hull.vertices, hull.faces)
    if solid.tag == "box":
        return Shape(*placed, "box", tuple(numbers_of(solid.get("size", "")).tolist()))
    if solid.tag == "sphere":
        return Shape(*placed, "sphere", (float(solid.get("radius", "nan")),))
    if solid.tag in {"cylinder", "capsule"}:
        size = (float(solid.get("radius", "nan")), float(solid.get("length", "nan")))
        return Shape(*placed, "capsule" if solid.tag == "capsule" else "cylinder", size)
    raise RobotError(
        f"unknown geometry {solid.tag!r}",
        source=robot.source,
        field=where,
        remedy="use a mesh, box or sphere",
    )


def origin_of(origin: ElementTree.Element | None) -> pin.SE3:
    """Placement that an ``<origin>`` states, none if there is no such element."""
    if origin is None:
        return pin.SE3.Identity()
    return pin.SE3(
        pin.rpy.rpyToMatrix(*numbers_of(origin.get("rpy", "0 0 0"))), numbers_of(origin.get("xyz", "0 0 0"))
    )


def numbers_of(text: str) -> Array:
    """Numbers of an attribute."""
    return np.array([float(part) for part in text.split()])
