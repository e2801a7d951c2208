"""Collision geometry of a robot: convex shapes on its joints and the pairs of them that matter."""

from __future__ import annotations

import warnings
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin
from defusedxml.ElementTree import fromstring
from numpy.typing import NDArray

from excite.errors import RobotError
from excite.robot.links import link_placement
from excite.robot.robot import Robot
from excite.robot.shapes.collada_axes import turn_upright
from excite.robot.shapes.ground import ground_height, ground_is_assumed, links_below
from excite.robot.shapes.link_shapes import link_shapes, links_by_kind
from excite.robot.shapes.mesh_files import read_meshes
from excite.robot.shapes.shape import Shape, coal_geometry

Array = NDArray[np.float64]

TABLE = "table"
_TABLE_SIZE = (4.0, 4.0, 1.0)


# By robot hash, so that a robot that was pickled to a worker process finds its geometry again.
_SHAPES: dict[str, tuple[Shape, ...]] = {}
_MODELS: dict[str, pin.GeometryModel] = {}
_WATCHED: dict[str, tuple[pin.GeometryModel, Array]] = {}


def collision_shapes(robot: Robot) -> tuple[Shape, ...]:
    """Convex shapes of a robot from what ``collision`` in its ``robot.yaml`` says.

    Meshes become convex hulls of at most ``hull_corners`` corners that contain every corner of the mesh
    (:func:`~excite.robot.shapes.meshes.convex_hull`). Shapes authored in ``robot.yaml`` are added to those
    of the URDF's ``collision`` or ``visual`` elements (``either``: the second of links without the first), or stand
    alone with ``geometry: authored``.
    A ``table_height``, or the ground that a fixed base does not state, adds a 4 m × 4 m × 1 m block below the base.

    Raises:
        RobotError: a mesh is missing or flat, an authored shape is malformed, or there is no shape at all.
    """
    if robot.hash not in _SHAPES:
        _SHAPES[robot.hash] = _build_shapes(robot)
    return _SHAPES[robot.hash]


def collision_model(robot: Robot) -> pin.GeometryModel:
    """Coal geometry of :func:`collision_shapes` with every pair of shapes that has to keep the margin.

    Left out are pairs on the same joint, on adjacent joints, and of the links in ``ignored_pairs`` and ``near_pairs``.
    The model is shared between callers: take a ``copy()`` before changing it.

    Raises:
        RobotError: as :func:`collision_shapes`, or ``ignored_pairs`` names a link without shape.
    """
    if robot.hash not in _MODELS:
        near = {frozenset(pair.links) for pair in robot.description.collision.near_pairs}
        _MODELS[robot.hash] = _model(robot, near)
    return _MODELS[robot.hash]


def watched_model(robot: Robot) -> tuple[pin.GeometryModel, Array]:
    """:func:`collision_model` with ``near_pairs`` too, and the distance that each pair keeps, ``(n_pairs,)`` [m]."""
    block = robot.description.collision
    if not block.near_pairs:
        model = collision_model(robot)
        return model, np.full(len(model.collisionPairs), block.margin)
    if robot.hash not in _WATCHED:
        model, own = _model(robot), {frozenset(pair.links): pair.distance for pair in block.near_pairs}
        links = [shape.link for shape in collision_shapes(robot)]
        pairs = (frozenset((links[pair.first], links[pair.second])) for pair in model.collisionPairs)
        _WATCHED[robot.hash] = model, np.array([own.get(pair, block.margin) for pair in pairs])
    return _WATCHED[robot.hash]


def _model(robot: Robot, without: Collection[frozenset[str]] = ()) -> pin.GeometryModel:
    """Geometry with every pair that matters, but for some pairs of links."""
    shapes = collision_shapes(robot)
    model = pin.GeometryModel()
    for shape in shapes:
        geometry = coal_geometry(shape)
        model.addGeometryObject(pin.GeometryObject(shape.name, shape.joint, shape.placement, geometry))
    for first, second in shape_pairs(robot, shapes, _ignored_pairs(robot, shapes).union(without)):
        model.addCollisionPair(pin.CollisionPair(first, second))
    return model


def geometry_data(geometry: pin.GeometryModel) -> pin.GeometryData:
    """Data for a geometry model in which no answer depends on what was asked before.

    Coal would begin each search where the last one of the same pair ended, and end up to 1e-6 m elsewhere: the same
    question would have an answer for each history. That saves a tenth of the time of distances of a G1, and none of a
    UR10's or of the search for collisions.
    """
    data = geometry.createData()
    with warnings.catch_warnings():
        # What coal names in its place, gjk_initial_guess, does not take it away.
        warnings.simplefilter("ignore", DeprecationWarning)
        for request in (*data.distanceRequests, *data.collisionRequests):
            request.enable_cached_gjk_guess = False
    return data


def bounding_balls(geometry: pin.GeometryModel) -> tuple[Array, Array]:
    """Balls about the shapes of a geometry model.

    Returns:
        Centres ``(n_shapes, 3)`` [m] in the shapes' own frames; radii ``(n_shapes,)`` [m], infinite of what has no end.
    """
    centres, radii = [], []
    for item in geometry.geometryObjects:
        item.geometry.computeLocalAABB()
        centre, radius = np.array(item.geometry.aabb_center).ravel(), float(item.geometry.aabb_radius)
        ends = bool(np.isfinite(radius) and np.isfinite(centre).all())
        centres.append(centre if ends else np.zeros(3))
        radii.append(radius if ends else np.inf)
    return np.array(centres), np.array(radii)


def pair_distance(geometry: pin.GeometryModel, data: pin.GeometryData, pair: int) -> float:
    """Distance of a pair of shapes whose placements are up to date, negative in penetration [m].

    It is rounded to a tenth of the 1e-6 m to which coal knows it: further digits are not the robot's. Of the same
    shapes and placements, two processes that had done different things before got distances 1e-12 m apart.
    """
    return round(float(pin.computeDistance(geometry, data, pair).min_distance), 7)


def shape_pairs(
    robot: Robot, shapes: tuple[Shape, ...], ignored: frozenset[frozenset[str]] = frozenset()
) -> list[tuple[int, int]]:
    """Pairs of shape indices that neither share a joint, nor sit on adjacent joints, nor are ignored.

    Joints whose links meet where a loop closes are adjacent, too.
    """
    parents = list(robot.model.parents)
    meeting = set() if robot.mechanism is None else robot.mechanism.meeting
    pairs = []
    for first, one in enumerate(shapes):
        for second in range(first + 1, len(shapes)):
            other = shapes[second]
            if one.joint == other.joint:
                continue
            if parents[one.joint] == other.joint or parents[other.joint] == one.joint:
                continue
            if frozenset((one.joint, other.joint)) in meeting:
                continue
            if frozenset((one.link, other.link)) not in ignored:
                pairs.append((first, second))
    return pairs


def mesh_points(links: list[Element], kind: str, partial: frozenset[str] = frozenset()) -> dict[Path, Array]:
    """Corners of the meshes of links; those of links in ``partial`` as far as they can be read."""
    needed, others = list[Path](), list[Path]()
    for link in links:
        files = [Path(mesh.get("filename", "")) for mesh in link.iterfind(f"{kind}/geometry/mesh")]
        (others if link.get("name", "") in partial else needed).extend(files)
    points = read_meshes(needed)
    for file in set(others) - set(needed):
        with suppress(RobotError):
            points |= read_meshes([file])
    return dict(turn_upright(links, kind, points))


def _ignored_pairs(robot: Robot, shapes: tuple[Shape, ...]) -> frozenset[frozenset[str]]:
    links = {shape.link for shape in shapes}
    block = robot.description.collision
    near = tuple(pair.links for pair in block.near_pairs)
    for field, named in (("ignored_pairs", block.ignored_pairs), ("near_pairs", near)):
        for link in (link for pair in named for link in pair if link not in links):
            raise RobotError(
                f"no shape on link {link!r}",
                source=robot.source,
                field=f"collision.{field}",
                remedy="links with shapes are " + ", ".join(sorted(links)),
            )
    pairs = {frozenset(pair) for pair in block.ignored_pairs}
    if ground_is_assumed(robot.description):
        own = [shape for shape in shapes if shape.link != TABLE]
        height = ground_height(robot.model, own, robot.rest)
        margin = robot.description.collision.margin
        pairs |= {
            frozenset((link, TABLE)) for link in links_below(robot.model, own, robot.rest, height, margin)
        }
    return frozenset(pairs)


def _check_below(robot: Robot, height: float) -> None:
    """Refuse a table or ground above all joints at rest: the robot would be in it, or hang below its four metres."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.rest)
    highest = max(float(place.translation[2]) for place in list(data.oMi)[1:])
    if robot.description.base == "fixed" and height > max(highest, 0.0):
        raise RobotError(
            f"is {height:g} m, above all joints at rest (the highest at {highest:.3g} m)",
            source=robot.source,
            field="collision.table_height",
            remedy="give its height in the base's frame, or null where nothing is there",
        )


def _build_shapes(robot: Robot) -> tuple[Shape, ...]:
    block = robot.description.collision
    shapes: list[Shape] = []
    if block.geometry != "authored":
        links = fromstring(robot.urdf).findall("link")
        for kind, shown in links_by_kind(links, block.geometry).items():
            points = mesh_points(shown, kind, frozenset(block.stand_ins))
            for link in shown:
                shapes += link_shapes(
                    robot, link, kind, points, partial=link.get("name", "") in block.stand_ins
                )
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
    height = block.table_height
    if ground_is_assumed(robot.description):
        height = ground_height(robot.model, shapes, robot.rest)
    if height is not None:
        _check_below(robot, height)
        below = pin.SE3(np.eye(3), np.array([0.0, 0.0, height - 0.5 * _TABLE_SIZE[2]]))
        shapes.append(Shape(TABLE, TABLE, 0, below, "box", _TABLE_SIZE))
    return tuple(shapes)
