"""Bodies of a robot as few triangles, for a picture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from defusedxml.ElementTree import fromstring
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import RobotError
from excite.robot.links import link_placement
from excite.robot.robot import Robot
from excite.robot.shapes.collision import TABLE, collision_shapes
from excite.robot.shapes.mesh_files import read_meshes

Triangles = NDArray[np.int64]

# Cells along the longest side of a body, of which each keeps one corner. Of G1's 35 meshes of 290 000 triangles 24
# cells leave 58 000, 0.37 MB on the page, on which a hand's fingers can still be told; 12 leave 0.14, 48 0.77 MB.
CELLS = 24

_SHORTEST_BONE = 0.005
# Radius of a rod, as a share of the median length: looked at on a xArm 7 and a G1, of which all rods can be told.
_THICK = 0.15


@dataclass(frozen=True, eq=False)
class Body:
    """A part of a robot that moves with a joint.

    Attributes:
        link: name of its link.
        joint: index of the model joint that carries it, 0 for the world.
        corners: ``(n, 3)`` in the frame of that joint [m].
        triangles: ``(m, 3)`` indices of corners, anticlockwise from outside.
    """

    link: str
    joint: int
    corners: Array
    triangles: Triangles


def visible_bodies(robot: Robot) -> tuple[Body, ...]:
    """What is to be seen of a robot: its visual meshes, else its collision meshes or shapes, else its bones.

    Meshes are taken where all of a kind are STL, which is read at once: a Collada file takes a second, and what it
    shows beyond the collision meshes is paint. Corners are merged in a grid of :data:`CELLS` along a body.

    Returns:
        The bodies; of a robot without geometry, or whose meshes are not there, a rod from each joint to the next.
    """
    try:
        return tuple(_of_meshes(robot)) or tuple(_of_shapes(robot))
    except RobotError:
        return tuple(_bone_bodies(robot))


def merge_corners(corners: Array, triangles: Triangles, cells: int = CELLS) -> tuple[Array, Triangles]:
    """Fewer corners: those in one cell of a grid become their mean (Rossignac and Borrel 1993, section 4).

    Args:
        corners: ``(n, 3)`` [m].
        triangles: ``(m, 3)``.
        cells: along the longest side.

    Returns:
        Corners and triangles; those that became lines or points are left out, and so are their doubles.
    """
    low = corners.min(axis=0)
    size = max(float(np.ptp(corners, axis=0).max()), 1e-9) / cells
    cell = np.minimum(((corners - low) / size).astype(np.int64), cells - 1)
    key = (cell[:, 0] * cells + cell[:, 1]) * cells + cell[:, 2]
    member, used = _renumber(key, cells**3)
    count = np.bincount(member)
    means = np.column_stack([np.bincount(member, corners[:, i]) / count for i in range(3)])
    left = member[triangles]
    a, b, c = left.T
    left = left[(a != b) & (b != c) & (c != a)]
    if not len(left):
        return means, left
    # A triangle's corners in one order, beginning with the least, so that the same one is found again.
    start = np.argmin(left, axis=1)
    a, b, c = (left[np.arange(len(left)), (start + k) % 3] for k in range(3))
    n = len(used)
    each = np.unique((a * n + b) * n + c)
    left = np.column_stack([each // n**2, each // n % n, each % n])
    again, used = _renumber(left.ravel(), n)
    return means[used], again.reshape(left.shape)


def _renumber(values: NDArray[np.int64], most: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Whole numbers below ``most`` counted anew, in their order, and those that there are."""
    present = np.bincount(values, minlength=most) > 0
    return (np.cumsum(present) - 1)[values], np.flatnonzero(present)


def _of_meshes(robot: Robot) -> Iterator[Body]:
    root = fromstring(robot.urdf)
    for kind in ("visual", "collision"):
        files = [Path(m.get("filename", "")) for m in root.iterfind(f"link/{kind}/geometry/mesh")]
        if files and all(file.suffix.lower() == ".stl" for file in files):
            break
    else:
        return
    points = read_meshes(files)
    for link in root.findall("link"):
        name = link.get("name", "")
        for element in link.findall(kind):
            solid = element.find("geometry/*")
            if solid is None:
                continue
            joint, placement = link_placement(robot.model, name, robot.source, f"link {name!r}")
            if solid.tag == "mesh":
                # An STL file's corners stand triangle after triangle.
                corners = points[Path(solid.get("filename", ""))] * _element_numbers(
                    solid, "scale", (1.0, 1.0, 1.0)
                )
                triangles = np.arange(len(corners)).reshape(-1, 3)
            else:
                corners, triangles = solid_triangles(solid.tag, _solid_size(solid))
            corners, triangles = merge_corners(corners, triangles)
            yield _place_body(name, joint, placement * _element_origin(element), corners, triangles)


def _of_shapes(robot: Robot) -> Iterator[Body]:
    for shape in collision_shapes(robot):
        if shape.link == TABLE:
            continue
        if shape.vertices is not None and shape.faces is not None:
            corners, triangles = shape.vertices, shape.faces
        else:
            corners, triangles = solid_triangles(shape.kind, shape.size)
        yield _place_body(shape.link, shape.joint, shape.placement, corners, triangles)


def _bone_bodies(robot: Robot) -> Iterator[Body]:
    """Rods from each joint to those that it carries, and from the last ones through what they carry."""
    model, found = robot.model, []
    for joint in range(1, model.njoints):
        ends = [model.jointPlacements[child].translation for child in model.children[joint]]
        ends = ends or [2.0 * model.inertias[joint].lever]
        found += [(joint, np.array(end)) for end in ends if np.linalg.norm(end) > _SHORTEST_BONE]
    usual = float(np.median([np.linalg.norm(end) for _, end in found])) if found else 0.0
    for joint, end in found:
        length = float(np.linalg.norm(end))
        corners, triangles = solid_triangles("capsule", (_THICK * usual, length))
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end / length)
        link = robot.segments[joint - 1].link
        yield _place_body(link, joint, pin.SE3(turn.matrix(), 0.5 * end), corners, triangles)


def _place_body(link: str, joint: int, pose: pin.SE3, corners: Array, triangles: Triangles) -> Body:
    return Body(link, joint, corners @ pose.rotation.T + pose.translation, triangles)


def _solid_size(solid: ElementTree.Element) -> tuple[float, ...]:
    if solid.tag == "box":
        return tuple(_element_numbers(solid, "size", (1.0, 1.0, 1.0)))
    return tuple(float(solid.get(name, "0")) for name in ("radius", "length") if solid.get(name))


def _element_origin(element: ElementTree.Element) -> pin.SE3:
    origin = element.find("origin")
    if origin is None:
        return pin.SE3.Identity()
    zero = (0.0, 0.0, 0.0)
    return pin.SE3(
        pin.rpy.rpyToMatrix(*_element_numbers(origin, "rpy", zero)), _element_numbers(origin, "xyz", zero)
    )


def _element_numbers(element: ElementTree.Element, name: str, otherwise: tuple[float, ...]) -> Array:
    text = element.get(name)
    return np.array(otherwise if text is None else [float(part) for part in text.split()])


# Boxes, balls, cylinders and capsules as triangles.

# Corners around: a cylinder's edge stays within 3 % of its radius.
_AROUND = 14
_RINGS = 3
# Of a box whose corners count up in binary, x first: two triangles a side, anticlockwise from outside.
_SIDES = np.array(
    [
        *[[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5]],
        *[[0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]],
        *[[0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]],
    ]
)


def solid_triangles(kind: str, size: tuple[float, ...]) -> tuple[Array, NDArray[np.int64]]:
    """Corners ``(n, 3)`` [m] and triangles ``(m, 3)`` of a solid in its own frame, anticlockwise from outside.

    Args:
        kind: ``box``, ``sphere``, ``cylinder`` or ``capsule``; anything else has none.
        size: as of :class:`~excite.robot.shapes.shape.Shape`.
    """
    if kind == "box":
        corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        return corners * np.array(size), _SIDES
    if kind not in {"sphere", "cylinder", "capsule"}:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    radius, half = size[0], 0.5 * size[1] if kind != "sphere" else 0.0
    if kind == "cylinder":
        return _turned_body([(-half, radius), (half, radius)], (-half, half))
    rise = np.linspace(0.0, 0.5 * np.pi, _RINGS, endpoint=False)
    upper = [(half + radius * float(np.sin(t)), radius * float(np.cos(t))) for t in rise]
    lower = [(-height, width) for height, width in reversed(upper)]
    # A ball's two halves share their equator.
    return _turned_body(lower + upper[kind == "sphere" :], (-half - radius, half + radius))


def _turned_body(
    rings: list[tuple[float, float]], poles: tuple[float, float]
) -> tuple[Array, NDArray[np.int64]]:
    """A body turned about z, of rings (height, radius) from below and the heights of its lowest and highest point."""
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    levels = [np.column_stack([radius * circle, np.full(_AROUND, height)]) for height, radius in rings]
    corners = np.vstack([*levels, [[0.0, 0.0, poles[0]], [0.0, 0.0, poles[1]]]])
    here, bottom = np.arange(_AROUND), len(corners) - 2
    after, last = np.roll(here, -1), (len(rings) - 1) * _AROUND
    triangles = [np.column_stack([np.full(_AROUND, bottom), after, here])]
    for below in range(0, last, _AROUND):
        above = below + _AROUND
        triangles.append(np.column_stack([below + here, below + after, above + after]))
        triangles.append(np.column_stack([below + here, above + after, above + here]))
    triangles.append(np.column_stack([last + here, last + after, np.full(_AROUND, bottom + 1)]))
    return corners, np.vstack(triangles)
