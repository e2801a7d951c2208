"""Which way up Collada meshes are meant: their file says an axis, which some readers of URDF heed and others do not."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from excite.arrays import Array
from excite.robot.shapes.link_shapes import numbers_of, origin_of

# The axis stands in a file's head, before any geometry.
_HEAD_BYTES = 16_384
# From the file's axes to those of a frame whose z is up (Collada 1.4.1, element up_axis).
_UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
# A link speaks where the readings differ by this share of its size. In example-robot-data 15 links of 16 of the iCub
# speak for meshes turned upright; of TIAGo, two flying arms and two other iCubs 46 of 47 for meshes as they are.
_DIFFERENCE = 0.02
# Fewer votes than these could be chance: without them meshes are read as RViz and pinocchio read them.
_VOTES, _MAJORITY = 3, 0.75


def turn_upright(
    links: list[ElementTree.Element], kind: str, points: Mapping[Path, Array]
) -> Mapping[Path, Array]:
    """Corners of meshes by file, those with y up turned upright where the links' centres of mass say so.

    RViz and pinocchio read such files as they are, other viewers turn them, and models are drawn for one or the other.
    Meant is the reading under which links' centres of mass lie nearer to the middles of their meshes.

    Args:
        links: the URDF's links, with their inertials.
        kind: ``collision`` or ``visual``.
        points: corners as they stand in the files ``(n, 3)``, by file.
    """
    turned = {path: corners @ _UPRIGHT.T for path, corners in points.items() if _y_up(path)}
    if not turned:
        return points
    votes = [_axis_vote(link, kind, points, turned) for link in links]
    as_is, otherwise = votes.count(-1), votes.count(1)
    if otherwise < _VOTES or otherwise < _MAJORITY * (as_is + otherwise):
        return points
    return {**points, **turned}


def _y_up(path: Path) -> bool:
    if path.suffix.lower() != ".dae":
        return False
    with path.open("rb") as stream:
        return b"Y_UP" in stream.read(_HEAD_BYTES)


def _axis_vote(
    link: ElementTree.Element, kind: str, points: Mapping[Path, Array], turned: Mapping[Path, Array]
) -> int:
    """1 of a link whose centre of mass speaks for turned meshes, -1 for meshes as they are, 0 if it says nothing."""
    inertial = link.find("inertial")
    meshes = [
        (element, mesh)
        for element in link.findall(kind)
        for mesh in element.iterfind("geometry/mesh")
        if Path(mesh.get("filename", "")) in points
    ]
    if inertial is None or not any(Path(mesh.get("filename", "")) in turned for _, mesh in meshes):
        return 0
    centre = origin_of(inertial.find("origin")).translation
    off: list[float] = []
    for reading in (points, {**points, **turned}):
        corners = np.vstack([_place_points(element, mesh, reading) for element, mesh in meshes])
        low, high = corners.min(axis=0), corners.max(axis=0)
        size = max(float(np.linalg.norm(high - low)), 1e-9)
        off.append(float(np.linalg.norm(centre - 0.5 * (low + high))) / size)
    if abs(off[0] - off[1]) < _DIFFERENCE:
        return 0
    return 1 if off[1] < off[0] else -1


def _place_points(
    element: ElementTree.Element, mesh: ElementTree.Element, points: Mapping[Path, Array]
) -> Array:
    corners = points[Path(mesh.get("filename", ""))] * numbers_of(mesh.get("scale", "1 1 1"))
    pose = origin_of(element.find("origin"))
    return np.asarray(corners @ pose.rotation.T + pose.translation)
