"""Collision geometry of a robot: convex shapes on its joints and the pairs of them that matter."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin
from defusedxml.ElementTree import fromstring

from excite.arrays import Array
from excite.errors import RobotError
from excite.robot.description import RobotDescription
from excite.robot.links import link_placement
from excite.robot.prismatic import is_prismatic
from excite.robot.refusal import robot_error
from excite.robot.robot import Robot
from excite.robot.shapes.link_shapes import link_shapes, links_by_kind, numbers_of
from excite.robot.shapes.mesh_files import read_meshes
from excite.robot.shapes.shape import (
    Shape,
    bottom_points,
    coal_geometry,
    joints_at,
    place_points,
    shape_bounds,
    shape_points,
)
from excite.robot.urdf.numbers import read_origin

TABLE, CELL = "table", "cell"
SURROUNDINGS = (TABLE, CELL)
"""Links that shapes beside the robot stand under."""
_TABLE_SIZE = (4.0, 4.0, 1.0)


# By robot hash, so that a robot that was pickled to a worker process finds its geometry again.
_SHAPES: dict[str, tuple[Shape, ...]] = {}
_MODELS: dict[tuple[str, bool], tuple[pin.GeometryModel, Array]] = {}


def collision_shapes(robot: Robot) -> tuple[Shape, ...]:
    """Convex shapes of a robot from what ``collision`` in its ``robot.yaml`` says.

    Meshes become convex hulls of at most ``hull_corners`` corners that contain every corner of the mesh
    (:func:`~excite.robot.shapes.link_shapes.convex_hull`). Shapes authored in ``robot.yaml`` are added to those
    of the URDF's ``collision`` or ``visual`` elements (``either``: the second of links without the first), or stand
    alone with ``geometry: authored``.
    A ``table_height``, or the ground that a fixed base does not state, adds a 4 m × 4 m × 1 m block below the base, and
    a ``cell`` six walls of 1 m.

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
    return _watched_pairs(robot, near=False)[0]


def watched_model(robot: Robot) -> tuple[pin.GeometryModel, Array]:
    """:func:`collision_model` with ``near_pairs`` too, and the distance that each pair keeps, ``(n_pairs,)`` [m]."""
    return _watched_pairs(robot, near=bool(robot.description.collision.near_pairs))


def _watched_pairs(robot: Robot, *, near: bool) -> tuple[pin.GeometryModel, Array]:
    """Model and distances, with ``near_pairs`` or without."""
    if (robot.hash, near) not in _MODELS:
        block, shapes = robot.description.collision, collision_shapes(robot)
        own = {frozenset(pair.links): pair.distance for pair in block.near_pairs}
        left_out = _ignored_pairs(robot, shapes) | (frozenset() if near else frozenset(own))
        pairs = shape_pairs(robot, shapes, left_out)
        links = [frozenset((shapes[first].link, shapes[second].link)) for first, second in pairs]
        distances = np.array([own.get(pair, block.margin) for pair in links])
        _MODELS[robot.hash, near] = _geometry_model(shapes, pairs), distances
    return _MODELS[robot.hash, near]


def _geometry_model(shapes: Sequence[Shape], pairs: Sequence[tuple[int, int]]) -> pin.GeometryModel:
    model = pin.GeometryModel()
    for shape in shapes:
        geometry = coal_geometry(shape)
        model.addGeometryObject(pin.GeometryObject(shape.name, shape.joint, shape.placement, geometry))
    for pair in pairs:
        model.addCollisionPair(pin.CollisionPair(*pair))
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
    close = set() if robot.mechanism is None else robot.mechanism.meeting
    # A free base stands on no wall.
    close |= {
        frozenset((joint, parent)) for joint, parent in enumerate(parents) if parent or not robot.floating
    }
    return [
        (first, second)
        for first, second in itertools.combinations(range(len(shapes)), 2)
        if (joints := frozenset((shapes[first].joint, shapes[second].joint))) not in close
        and len(joints) == 2
        if frozenset((shapes[first].link, shapes[second].link)) not in ignored
    ]


def mesh_points(links: list[Element], kind: str, partial: frozenset[str] = frozenset()) -> dict[Path, Array]:
    """Corners of the meshes of links; those of links in ``partial`` as far as they can be read."""
    files = [
        (Path(mesh.get("filename", "")), link.get("name", "") in partial)
        for link in links
        for mesh in link.iterfind(f"{kind}/geometry/mesh")
    ]
    faults: dict[Path, RobotError] = {}
    points = read_meshes((file for file, _ in files), faults)
    for file, passed_over in files:
        if file in faults and not passed_over:
            raise faults[file]
    return dict(turn_upright(links, kind, points))


def _ignored_pairs(robot: Robot, shapes: tuple[Shape, ...]) -> frozenset[frozenset[str]]:
    links, block = {shape.link for shape in shapes}, robot.description.collision
    near = tuple(pair.links for pair in block.near_pairs)
    for field, named in (("ignored_pairs", block.ignored_pairs), ("near_pairs", near)):
        for link in (link for pair in named for link in pair if link not in links):
            what, remedy = f"no shape on link {link!r}", "links with shapes are " + ", ".join(sorted(links))
            raise robot_error(robot.source, f"collision.{field}", what, remedy)
    pairs = {frozenset(pair) for pair in block.ignored_pairs}
    if ground_is_assumed(robot.description):
        own = [shape for shape in shapes if shape.link not in SURROUNDINGS]
        height = ground_height(robot.model, own, robot.rest)
        below = links_below(robot.model, own, robot.rest, height, block.margin)
        pairs |= {frozenset((link, TABLE)) for link in below}
    return frozenset(pairs)


def _check_below(robot: Robot, height: float) -> None:
    """Refuse a table or ground above all joints at rest: the robot would be in it, or hang below its four metres."""
    data = joints_at(robot.model, robot.rest)
    highest = max(float(place.translation[2]) for place in list(data.oMi)[1:])
    if robot.description.base == "fixed" and height > max(highest, 0.0):
        what = f"is {height:g} m, above all joints at rest (the highest at {highest:.3g} m)"
        remedy = "give its height in the base's frame, or null where nothing is there"
        raise robot_error(robot.source, "collision.table_height", what, remedy)


def _build_shapes(robot: Robot) -> tuple[Shape, ...]:
    block = robot.description.collision
    shapes: list[Shape] = []
    links = [] if block.geometry == "authored" else fromstring(robot.urdf).findall("link")
    for kind, shown in links_by_kind(links, block.geometry).items():
        points = mesh_points(shown, kind, frozenset(block.stand_ins))
        for link in shown:
            partial = link.get("name", "") in block.stand_ins
            shapes += link_shapes(robot, link, kind, points, partial=partial)
    for authored in block.shapes:
        joint, placement = link_placement(robot.model, authored.link, robot.source, "collision.shapes")
        number = sum(shape.link == authored.link for shape in shapes)
        lengths = {"sphere": 1, "capsule": 2, "box": 3}[authored.kind]
        if len(authored.size) != lengths:
            what = f"a {authored.kind} on {authored.link} has {len(authored.size)} sizes"
            raise robot_error(robot.source, "collision.shapes", what, f"give {lengths}")
        pose = placement * pin.SE3(pin.rpy.rpyToMatrix(*authored.rpy), np.array(authored.xyz))
        name = f"{authored.link}_{number}"
        shapes.append(Shape(name, authored.link, joint, pose, authored.kind, authored.size))
    if not shapes:
        what, remedy = f"no geometry of kind {block.geometry!r}", "author shapes or name the other kind"
        raise robot_error(robot.source, "collision.geometry", what, remedy)
    height = block.table_height
    if ground_is_assumed(robot.description):
        height = ground_height(robot.model, shapes, robot.rest)
    if height is not None:
        _check_below(robot, height)
        below = pin.SE3(np.eye(3), np.array([0.0, 0.0, height - 0.5 * _TABLE_SIZE[2]]))
        shapes.append(Shape(TABLE, TABLE, 0, below, "box", _TABLE_SIZE))
    return tuple(shapes) + cell_walls(robot)


def cell_walls(robot: Robot) -> tuple[Shape, ...]:
    """Six boxes, 1 m thick, about the space that a description states; none where it states none.

    Raises:
        RobotError: its corners are not the lowest and the highest.
    """
    stated = robot.description.collision.cell
    if stated is None:
        return ()
    low, high = np.array(stated)
    if (low >= high).any():
        what, remedy = "has no room", "give the lowest corner, then the highest"
        raise robot_error(robot.source, "collision.cell", what, remedy)
    walls: list[Shape] = []
    for axis, side in itertools.product(range(3), (-1.0, 1.0)):
        centre, size = 0.5 * (low + high), high - low + 2.0
        centre[axis], size[axis] = (low, high)[side > 0.0][axis] + 0.5 * side, 1.0
        pose, extent = pin.SE3(np.eye(3), centre), tuple(size.tolist())
        walls.append(Shape(f"{CELL}_{len(walls)}", CELL, 0, pose, "box", extent))
    return tuple(walls)


# Which way up Collada meshes are meant: their file says an axis, which some readers of URDF heed and others
# do not.

# From the file's axes to those of a frame whose z is up (Collada 1.4.1, element up_axis).
_UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def turn_upright(links: list[Element], kind: str, points: Mapping[Path, Array]) -> Mapping[Path, Array]:
    """Corners of meshes by file, those with y up turned upright where the links' centres of mass say so.

    RViz and pinocchio read such files as they are, other viewers turn them, and models are drawn for one or the other.
    Meant is the reading under which links' centres of mass lie nearer to the middles of their meshes.

    Args:
        links: the URDF's links, with their inertials.
        kind: ``collision`` or ``visual``.
        points: corners as they stand in the files ``(n, 3)``, by file.
    """
    turned = {path: np.asarray(corners @ _UPRIGHT.T) for path, corners in points.items() if _y_up(path)}
    votes = [_axis_vote(link, kind, points, turned) for link in links] if turned else []
    as_is, otherwise = votes.count(-1), votes.count(1)
    # Fewer votes than these could be chance: without them meshes are read as RViz and pinocchio read them.
    if otherwise < 3 or otherwise < 0.75 * (as_is + otherwise):
        return points
    return {**points, **turned}


def _y_up(path: Path) -> bool:
    if path.suffix.lower() != ".dae":
        return False
    with path.open("rb") as stream:
        # The axis stands in a file's head, before any geometry.
        return b"Y_UP" in stream.read(16_384)


def _axis_vote(link: Element, kind: str, points: Mapping[Path, Array], turned: Mapping[Path, Array]) -> int:
    """1 of a link whose centre of mass speaks for turned meshes, -1 for meshes as they are, 0 if it says nothing."""
    inertial, off = link.find("inertial"), list[float]()
    meshes = [
        (
            read_origin(element),
            numbers_of(mesh.get("scale", "1 1 1")),
            Path(mesh.get("filename", "")),
        )
        for element in link.findall(kind)
        for mesh in element.iterfind("geometry/mesh")
        if Path(mesh.get("filename", "")) in points
    ]
    if inertial is None or not any(file in turned for *_, file in meshes):
        return 0
    centre = read_origin(inertial).translation
    for reading in (points, {**points, **turned}):
        corners = np.vstack([place_points(reading[file] * scale, pose) for pose, scale, file in meshes])
        low, high = corners.min(axis=0), corners.max(axis=0)
        size = max(float(np.linalg.norm(high - low)), 1e-9)
        off.append(float(np.linalg.norm(centre - 0.5 * (low + high))) / size)
    # A link speaks where the readings differ by this share of its size. In example-robot-data 15 links of 16 of the
    # iCub speak for meshes turned upright; of TIAGo, two flying arms and two other iCubs 46 of 47 for meshes as they
    # are.
    return 0 if abs(off[0] - off[1]) < 0.02 else 1 if off[1] < off[0] else -1


# The ground below a fixed base: never absent, so that no motion reaches through it unseen.

# Hulls of meshes stand out below a mounting plane by a hundredth of their size [m].
_FLANGE = 0.02
# Below all that a robot that hangs or is held up may reach [m].
_CLEAR = 0.1


def ground_is_assumed(description: RobotDescription) -> bool:
    """Whether a description with a fixed base leaves out where its ground is (null: there is none)."""
    return description.base == "fixed" and "table_height" not in description.collision.model_fields_set


def ground_height(model: pin.Model, shapes: Sequence[Shape], rest: Array, *, held_up: bool = False) -> float:
    """Height of the ground in the frame of a fixed base [m].

    It is the plane that the base is mounted on: that of its frame, or its lowest point where it stands on a pedestal.
    Of a robot that hangs, most of whose mass rests lower, and of one that is held up, it lies below all that the robot
    may reach.

    Args:
        model: the robot's, base fixed.
        rest: its posture of rest ``(n_joints,)``.
        held_up: whether it has legs that shall swing free of the ground.
    """
    data = model.createData()
    centre = whole_centre(model, data, rest)
    low = lowest_points(shapes, data)
    base = low.get(0, 0.0)
    plane = base if base < -_FLANGE else 0.0
    if held_up:
        return min(plane, *low.values(), -robot_reach(model, shapes, from_base=True)) - _CLEAR
    if centre[2] >= plane - _FLANGE:
        return plane
    together = sum(float(np.linalg.norm(place.translation)) for place in list(model.jointPlacements)[1:])
    return min(plane, *low.values()) - together - _CLEAR


def robot_reach(model: pin.Model, shapes: Sequence[Shape], *, from_base: bool) -> float:
    """Length that no limb exceeds, whatever its joints do, to the farthest point of its shapes [m].

    Args:
        model: the robot's, base fixed.
        from_base: measured from the base's frame, else from the limb's own first joint.
    """
    length = np.zeros(model.njoints)
    for joint in range(1, model.njoints):
        parent = model.parents[joint]
        if parent or from_base:
            length[joint] = length[parent] + np.linalg.norm(model.jointPlacements[joint].translation)
        if is_prismatic(model, model.idx_vs[joint]):
            at = model.joints[joint].idx_q
            length[joint] += max(abs(model.lowerPositionLimit[at]), abs(model.upperPositionLimit[at]))
    moving = [shape for shape in shapes if shape.joint or from_base]
    farthest = [np.linalg.norm(shape_points(shape), axis=1).max() + length[shape.joint] for shape in moving]
    return float(max(farthest, default=0.0))


def links_below(
    model: pin.Model, shapes: Sequence[Shape], rest: Array, ground: float, margin: float
) -> list[str]:
    """Links at or below the ground at rest, which are excepted from keeping ``margin`` [m] away from it."""
    data = joints_at(model, rest)
    found: dict[str, None] = {}
    for shape in shapes:
        # What hangs on the base's own joint is never compared with the ground.
        if shape.joint == 0 or model.parents[shape.joint] == 0:
            continue
        if bottom_points(shape, data.oMi[shape.joint])[:, 2].min() < ground + margin:
            found[shape.link] = None
    return list(found)


def whole_centre(model: pin.Model, data: pin.Data, q: Array) -> Array:
    """Centre of mass, the root's included ``(3,)`` [m]; ``data`` then holds where the joints are."""
    own = model.inertias[0]
    moving = pin.centerOfMass(model, data, q)
    mass = float(sum(inertia.mass for inertia in list(model.inertias)[1:]))
    return np.asarray((mass * moving + own.mass * own.lever) / max(mass + own.mass, 1e-9))


def lowest_points(shapes: Sequence[Shape], data: pin.Data) -> dict[int, float]:
    """Height of the lowest point on each joint that has shapes, where ``data`` has the joints, by joint [m]."""
    found: dict[int, float] = {}
    for shape in shapes:
        z = float(bottom_points(shape, data.oMi[shape.joint])[:, 2].min())
        found[shape.joint] = min(found.get(shape.joint, np.inf), z)
    return found


# Which pairs of links a collision check may leave out, computed from the geometry.

FAR = 0.02
"""Clearance beyond the margin that a pair must always keep to count as unable to meet [m]."""


@dataclass(frozen=True)
class PairReview:
    """Pairs of links by what the search found; each list is in the order of the shapes.

    Attributes:
        at_rest: neighbours (at most three joints between them) closer than the margin in the rest posture.
        always: closer than the margin in at least 99 % of random postures.
        never: neighbours that kept clear of each other in every posture of the search.
        rest_collisions: pairs that are no neighbours and are closer than the margin in the rest posture:
            the posture, not the pair, is at fault, so they are not to be ignored.
    """

    at_rest: tuple[tuple[str, str], ...]
    always: tuple[tuple[str, str], ...]
    never: tuple[tuple[str, str], ...]
    rest_collisions: tuple[tuple[str, str], ...]

    @property
    def ignored(self) -> tuple[tuple[str, str], ...]:
        """Pairs that may be ignored."""
        return tuple(dict.fromkeys((*self.at_rest, *self.always, *self.never)))


def review_pairs(
    robot: Robot,
    rng: np.random.Generator,
    n_random: int = 300,
    search: PairSearch | None = None,
    rest: Array | None = None,
) -> PairReview:
    """Search postures for pairs of links whose distance says nothing about safety.

    Random postures are uniform over the joint ranges; neighbours are also tried on the grid of
    lower limit, a quarter, middle, three quarters and upper limit of the joints between them.

    Args:
        robot: the robot; the ``ignored_pairs`` in its description play no part.
        rng: source of the random postures.
        n_random: how many.
        search: the robot's, if it is there already.
        rest: joints ``(n_joints,)`` of the rest posture; the robot's own where None.
    """
    search, margin = search or PairSearch(robot), robot.description.collision.margin
    near = search.link_distances(robot.rest if rest is None else search.whole_posture(rest))
    drawn = [search.link_distances(q) for q in robot.draw_configurations(rng, n_random)]
    random = np.array(drawn).reshape(n_random, len(search.pairs))
    found: dict[str, list[tuple[str, str]]] = {
        kind: [] for kind in ("at_rest", "always", "never", "rest_collisions")
    }
    for column, pair in enumerate(search.pairs):
        between = search.joints_between(pair)
        # Joints between two links up to which their relative posture is searched in full.
        neighbours = len(between) <= 3
        if np.mean(random[:, column] < margin) >= 0.99:
            found["always"].append(pair)
        elif near[column] < margin:
            found["at_rest" if neighbours else "rest_collisions"].append(pair)
        # On the grid a mechanism is open.
        elif neighbours and TABLE not in pair and robot.mechanism is None:
            if random[:, column].min() > margin + FAR and search.grid_minimum(column, between) > margin + FAR:
                found["never"].append(pair)
    return PairReview(**{kind: tuple(pairs) for kind, pairs in found.items()})


class PairSearch:
    """Distances between links, over all pairs that are not adjacent.

    Attributes:
        pairs: of links, in the order of the shapes.
    """

    def __init__(self, robot: Robot):
        shapes = collision_shapes(robot)
        self.robot = robot
        index_pairs = shape_pairs(robot, shapes)
        self.geometry = _geometry_model(shapes, index_pairs)
        names = [(shapes[first].link, shapes[second].link) for first, second in index_pairs]
        self.pairs = list(dict.fromkeys(names))
        column = {pair: index for index, pair in enumerate(self.pairs)}
        self.columns = np.array([column[name] for name in names], dtype=np.int64)
        self.joints = {shape.link: shape.joint for shape in shapes}
        self.data, self.geometry_data = robot.model.createData(), geometry_data(self.geometry)

    def whole_posture(self, joints: Array) -> Array:
        """A configuration ``(nq,)`` with the joints' positions given and the base at rest."""
        q = self.robot.rest.copy()
        q[self.robot.n_base_q :] = joints
        return q

    def link_distances(self, q: Array) -> Array:
        """Smallest distance of each pair of links [m], ``(n_pairs,)``."""
        pin.computeDistances(self.robot.model, self.data, self.geometry, self.geometry_data, q)
        found = np.full(len(self.pairs), np.inf)
        every = np.array([result.min_distance for result in self.geometry_data.distanceResults])
        np.minimum.at(found, self.columns, every)
        return found

    def joints_between(self, pair: tuple[str, str]) -> list[int]:
        """Model joints that change the pose of one link relative to the other."""
        first, second = (set(self.robot.model.supports[self.joints[link]]) for link in pair)
        return sorted(first ^ second)

    def grid_minimum(self, column: int, between: list[int]) -> float:
        """Smallest distance of one pair over the grid of the joints between its links [m]."""
        lower, upper = self.robot.limits.position_lower, self.robot.limits.position_upper
        first = self.robot.model.njoints - self.robot.n_joints
        wanted = np.flatnonzero(self.columns == column)
        places = [joint - first for joint in between if joint >= first]
        smallest = np.inf
        for fractions in itertools.product((0.0, 0.25, 0.5, 0.75, 1.0), repeat=len(places)):
            joints = self.robot.rest[self.robot.n_base_q :].copy()
            joints[places] = lower[places] + np.array(fractions) * (upper - lower)[places]
            pin.updateGeometryPlacements(
                self.robot.model, self.data, self.geometry, self.geometry_data, self.whole_posture(joints)
            )
            for index in wanted:
                result = pin.computeDistance(self.geometry, self.geometry_data, int(index))
                smallest = min(smallest, result.min_distance)
        return smallest


# Boxes in which the centre of mass of each segment must lie.

BARE = 0.05
"""Half side of the box about the nominal CoM of a segment that has no geometry [m]."""


def com_boxes(robot: Robot) -> Array:
    """Box of each segment that contains its CoM for certain, for constraints on first moments.

    It is the bounding box, along the axes of the segment's joint frame, of the collision geometry that the
    joint carries, grown a little and extended to contain the nominal CoM. ``segments.com_box`` in
    ``robot.yaml`` overrides it; a segment without geometry gets a box of 0.1 m around its nominal CoM.

    Returns:
        Lower and upper corners in the joint frames, ``(n_segments, 2, 3)`` [m].

    Raises:
        RobotError: the collision geometry cannot be built.
    """
    boxes = np.empty((len(robot.segments), 2, 3))
    shapes = [shape for shape in collision_shapes(robot) if shape.link not in SURROUNDINGS]
    for index, segment in enumerate(robot.segments):
        stated = robot.description.segments.com_box.get(segment.link)
        if stated is not None:
            boxes[index] = stated
            continue
        mass, *moment = robot.nominal_parameters[10 * index : 10 * index + 4]
        centre = np.array(moment) / mass if mass > 0.0 else np.zeros(3)
        bounds = [shape_bounds(shape) for shape in shapes if shape.joint == segment.joint]
        if bounds:
            lower = np.min([low for low, _ in bounds], axis=0)
            upper = np.max([high for _, high in bounds], axis=0)
            # Growth of the geometry's bounding box on every side, as a share of its length.
            # Least growth on every side [m].
            growth = np.maximum(0.05 * (upper - lower), 0.005)
            boxes[index] = np.minimum(lower - growth, centre), np.maximum(upper + growth, centre)
        else:
            boxes[index] = centre - BARE, centre + BARE
    return boxes
