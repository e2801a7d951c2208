"""Collision geometry of a robot: convex shapes on its joints and the pairs of them that matter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin
from defusedxml.ElementTree import fromstring
from numpy.typing import NDArray

from excite.errors import RobotError
from excite.robot.links import link_placement
from excite.robot.quantities import MAX_TRAVEL
from excite.robot.robot import Robot
from excite.robot.shapes.mesh_files import read_meshes
from excite.robot.shapes.meshes import convex_hull

Array = NDArray[np.float64]
Kind = Literal["convex", "box", "capsule", "sphere", "cylinder"]

TABLE = "table"
_TABLE_SIZE = (4.0, 4.0, 1.0)
# A hull of 96 corners may have to grow by a hundredth; of a smooth body the growth falls with the corners' square.
_CORNERS, _SLACK = 96, 0.01


@dataclass(frozen=True, eq=False)
class Shape:
    """A convex solid that moves with a joint.

    Attributes:
        name: unique name, ``LINK_NUMBER``.
        link: link that it belongs to (``table`` for the surface that a fixed base stands on).
        joint: index of the model joint that carries it, 0 for the world.
        placement: its pose in the frame of that joint.
        kind: ``convex``, ``box``, ``capsule``, ``sphere`` or ``cylinder``.
        size: [m] box: full lengths along x, y, z; sphere: radius; capsule and cylinder: radius and
            length along z (of a capsule: without its caps); empty for ``convex``.
        vertices: corners of a ``convex`` in its own frame, ``(n, 3)`` [m], else None.
        faces: triangles of a ``convex`` as vertex indices, ``(m, 3)``, anticlockwise from outside, else None.
    """

    name: str
    link: str
    joint: int
    placement: pin.SE3
    kind: Kind
    size: tuple[float, ...] = ()
    vertices: Array | None = None
    faces: NDArray[np.int64] | None = None


# By robot hash, so that a robot that was pickled to a worker process finds its geometry again.
_SHAPES: dict[str, tuple[Shape, ...]] = {}
_MODELS: dict[str, pin.GeometryModel] = {}


def collision_shapes(robot: Robot) -> tuple[Shape, ...]:
    """Convex shapes of a robot from what ``collision`` in its ``robot.yaml`` says.

    Meshes become convex hulls of at most ``hull_corners`` corners that contain every corner of the mesh
    (:func:`~excite.robot.shapes.meshes.convex_hull`). Shapes authored in ``robot.yaml`` are added to those
    of the URDF's ``collision`` or ``visual`` elements, or stand alone with ``geometry: authored``.
    A ``table_height`` adds a 4 m × 4 m × 1 m block below the base.

    Raises:
        RobotError: a mesh is missing or flat, an authored shape is malformed, or there is no shape at all.
    """
    if robot.hash not in _SHAPES:
        _SHAPES[robot.hash] = _build_shapes(robot)
    return _SHAPES[robot.hash]


def collision_model(robot: Robot) -> pin.GeometryModel:
    """Coal geometry of :func:`collision_shapes` with every pair of shapes that has to stay apart.

    Left out are pairs on the same joint, on adjacent joints, and of the links in ``ignored_pairs``.
    The model is shared between callers: take a ``copy()`` before changing it.

    Raises:
        RobotError: as :func:`collision_shapes`, or ``ignored_pairs`` names a link without shape.
    """
    if robot.hash not in _MODELS:
        shapes = collision_shapes(robot)
        model = pin.GeometryModel()
        for shape in shapes:
            geometry = coal_geometry(shape)
            model.addGeometryObject(pin.GeometryObject(shape.name, shape.joint, shape.placement, geometry))
        for first, second in shape_pairs(robot, shapes, _ignored(robot, shapes)):
            model.addCollisionPair(pin.CollisionPair(first, second))
        _MODELS[robot.hash] = model
    return _MODELS[robot.hash]


def shape_pairs(
    robot: Robot, shapes: tuple[Shape, ...], ignored: frozenset[frozenset[str]] = frozenset()
) -> list[tuple[int, int]]:
    """Pairs of shape indices that neither share a joint, nor sit on adjacent joints, nor are ignored."""
    parents = list(robot.model.parents)
    pairs = []
    for first, one in enumerate(shapes):
        for second in range(first + 1, len(shapes)):
            other = shapes[second]
            if one.joint == other.joint:
                continue
            if parents[one.joint] == other.joint or parents[other.joint] == one.joint:
                continue
            if frozenset((one.link, other.link)) not in ignored:
                pairs.append((first, second))
    return pairs


def coal_geometry(shape: Shape) -> coal.CollisionGeometry:
    """The coal geometry of a shape, in the shape's own frame."""
    if shape.kind == "convex":
        points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        for vertex in shape.vertices if shape.vertices is not None else ():
            points.append(vertex)
        for face in shape.faces if shape.faces is not None else ():
            triangles.append(coal.Triangle(*(int(i) for i in face)))
        geometry = coal.Convex(points, triangles)
    else:
        makers = {"box": coal.Box, "capsule": coal.Capsule, "sphere": coal.Sphere, "cylinder": coal.Cylinder}
        geometry = makers[shape.kind](*shape.size)
    geometry.computeLocalAABB()
    return geometry


def shape_points(shape: Shape) -> Array:
    """Corners of a shape, or of the box around it, in the frame of its joint, ``(n, 3)`` [m]."""
    if shape.vertices is not None:
        points = shape.vertices
    else:
        radius, length = shape.size[0], shape.size[-1]
        half = {
            "box": 0.5 * np.array(shape.size),
            "sphere": np.full(3, radius),
            "cylinder": np.array([radius, radius, 0.5 * length]),
            "capsule": np.array([radius, radius, 0.5 * length + radius]),
        }[shape.kind]
        points = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return np.asarray(points @ shape.placement.rotation.T + shape.placement.translation)


def _ignored(robot: Robot, shapes: tuple[Shape, ...]) -> frozenset[frozenset[str]]:
    links = {shape.link for shape in shapes}
    for pair in robot.description.collision.ignored_pairs:
        for link in pair:
            if link not in links:
                raise RobotError(
                    f"no shape on link {link!r}",
                    source=robot.source,
                    field="collision.ignored_pairs",
                    remedy="links with shapes are " + ", ".join(sorted(links)),
                )
    return frozenset(frozenset(pair) for pair in robot.description.collision.ignored_pairs)


def _build_shapes(robot: Robot) -> tuple[Shape, ...]:
    block = robot.description.collision
    shapes: list[Shape] = []
    if block.geometry != "authored":
        root = fromstring(robot.urdf)
        meshes = root.iterfind(f"link/{block.geometry}/geometry/mesh")
        points = read_meshes(Path(mesh.get("filename", "")) for mesh in meshes)
        for link in root.findall("link"):
            shapes += _link_shapes(robot, link, block.geometry, points)
    for authored in block.shapes:
        joint, placement = link_placement(robot.model, authored.link, robot.source, "collision.shapes")
        number = sum(shape.link == authored.link for shape in shapes)
        lengths = {"sphere": 1, "capsule": 2, "box": 3}[authored.kind]
        if len(authored.size) != lengths:
            raise RobotError(
                f"a {authored.kind} on {authored.link} has {len(authored.size)} sizes",
                source=robot.source,
                field="collision.shapes",
                remedy=f"give {lengths}",
            )
        pose = pin.SE3(pin.rpy.rpyToMatrix(*authored.rpy), np.array(authored.xyz))
        name = f"{authored.link}_{number}"
        shapes.append(Shape(name, authored.link, joint, placement * pose, authored.kind, authored.size))
    if not shapes:
        raise RobotError(
            f"no geometry of kind {block.geometry!r}",
            source=robot.source,
            field="collision.geometry",
            remedy="author shapes or name the other kind",
        )
    if block.table_height is not None:
        below = pin.SE3(np.eye(3), np.array([0.0, 0.0, block.table_height - 0.5 * _TABLE_SIZE[2]]))
        shapes.append(Shape(TABLE, TABLE, 0, below, "box", _TABLE_SIZE))
    return tuple(shapes)


def _link_shapes(
    robot: Robot, link: ElementTree.Element, kind: str, points: Mapping[Path, Array]
) -> list[Shape]:
    name = link.get("name", "")
    shapes = []
    for number, element in enumerate(link.findall(kind)):
        where = f"link {name!r}, {kind} {number}"
        joint, placement = link_placement(robot.model, name, robot.source, where)
        pose = placement * _origin(element.find("origin"))
        geometry = element.find("geometry")
        solid = geometry[0] if geometry is not None and len(geometry) else None
        if solid is None:
            raise RobotError(
                "has no geometry", source=robot.source, field=where, remedy="remove or fill the element"
            )
        shapes.append(_solid(f"{name}_{number}", name, joint, pose, solid, robot, where, points))
    return shapes


def _solid(
    name: str,
    link: str,
    joint: int,
    pose: pin.SE3,
    solid: ElementTree.Element,
    robot: Robot,
    where: str,
    meshes: Mapping[Path, Array],
) -> Shape:
    if solid.tag == "mesh":
        corners = robot.description.collision.hull_corners
        points = meshes[Path(solid.get("filename", ""))] * _floats(solid.get("scale", "1 1 1"))
        if np.abs(points).max() > MAX_TRAVEL:
            raise RobotError(
                f"its mesh reaches {np.abs(points).max():.3g} m from its origin",
                source=robot.source,
                field=where,
                remedy='looks like millimetres: write scale="0.001 0.001 0.001"',
            )
        try:
            hull = convex_hull(points, corners, _SLACK * (_CORNERS / corners) ** 2)
        except ValueError as error:
            raise RobotError(
                str(error), source=robot.source, field=where, remedy="author a shape instead"
            ) from error
        return Shape(name, link, joint, pose, "convex", (), hull.vertices, hull.faces)
    if solid.tag == "box":
        return Shape(name, link, joint, pose, "box", tuple(_floats(solid.get("size", "")).tolist()))
    if solid.tag == "sphere":
        return Shape(name, link, joint, pose, "sphere", (float(solid.get("radius", "nan")),))
    if solid.tag in {"cylinder", "capsule"}:
        size = (float(solid.get("radius", "nan")), float(solid.get("length", "nan")))
        return Shape(name, link, joint, pose, "capsule" if solid.tag == "capsule" else "cylinder", size)
    raise RobotError(
        f"unknown geometry {solid.tag!r}",
        source=robot.source,
        field=where,
        remedy="use a mesh, box or sphere",
    )


def _origin(origin: ElementTree.Element | None) -> pin.SE3:
    if origin is None:
        return pin.SE3.Identity()
    return pin.SE3(
        pin.rpy.rpyToMatrix(*_floats(origin.get("rpy", "0 0 0"))), _floats(origin.get("xyz", "0 0 0"))
    )


def _floats(text: str) -> Array:
    return np.array([float(part) for part in text.split()])
