"""Links and joints of a model as its file states them: what can be read is, what cannot becomes a finding.

The strict reader stops at the first fault. To judge a description all of it has to be seen, so nothing here raises for
a number, a mesh or a joint that is wrong.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import RobotError
from excite.finding import Finding
from excite.robot.shapes.collision import turn_file_upright, turn_upright
from excite.robot.shapes.link_shapes import solid_shape
from excite.robot.shapes.mesh_files import read_meshes
from excite.robot.shapes.shape import CORNERS, Shape
from excite.robot.urdf.inertia import WEIGHTLESS
from excite.robot.urdf.numbers import read_numbers
from excite.robot.urdf.reading import find_mesh
from excite.robot.urdf.tree import MOVING, link_at

MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_ROUND = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)


@dataclass(frozen=True, eq=False)
class Solid:
    """A convex body.

    Attributes:
        points: corners ``(n, 3)`` [m].
        planes: outward normals and offsets of its faces, ``(m, 4)``; a point p is inside where normal·p + offset ≤ 0.
        volume: [m³].
    """

    points: Array
    planes: Array
    volume: float

    @cached_property
    def size(self) -> float:
        """Diagonal of its bounding box [m]."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @cached_property
    def spread(self) -> tuple[Array, Array]:
        """Centre ``(3,)`` [m] and covariance ``(3, 3)`` [m²] of a body of even density in it."""
        from scipy.spatial import ConvexHull

        hull = ConvexHull(self.points)
        inside = self.points.mean(axis=0)
        corners = self.points[hull.simplices] - inside
        volumes = np.abs(np.linalg.det(corners)) / 6.0
        sums = corners.sum(axis=1)
        centre = (volumes[:, None] * sums).sum(axis=0) / 4.0 / volumes.sum()
        # Second moments of a tetrahedron with one corner at the origin: ΣΣ (xᵢxⱼᵀ)(1 + δᵢⱼ) V / 20.
        squares = np.einsum("t,tki,tkj->ij", volumes, corners, corners)
        squares += np.einsum("t,ti,tj->ij", volumes, sums, sums)
        return centre + inside, squares / 20.0 / volumes.sum() - np.outer(centre, centre)

    def distance(self, point: Array) -> float:
        """How far outside a point is, at least [m]; negative inside."""
        return float((self.planes[:, :3] @ point + self.planes[:, 3]).max())

    def nearest(self, point: Array) -> Array:
        """The point of the body nearest to one outside, by Dykstra's projection onto its half-spaces."""
        found, steps = point.copy(), np.zeros((len(self.planes), 3))
        for _ in range(200):
            before = found.copy()
            for index, plane in enumerate(self.planes):
                free = found + steps[index]
                found = free - max(0.0, plane[:3] @ free + plane[3]) * plane[:3]
                steps[index] = free - found
            if np.abs(found - before).max() < 1e-6:
                break
        return found


class _Inertial(NamedTuple):
    """The inertial of a link as :class:`DescribedLink` states it."""

    mass: float | None
    com: Array
    stated: Array
    step: float
    axes: Array


@dataclass(frozen=True, eq=False)
class DescribedLink:
    """A link with its inertial as stated.

    Attributes:
        name: of the link.
        mass: [kg]; None where it states none that can be read.
        com: centre of mass in the link's frame ``(3,)`` [m].
        stated: ixx, ixy, ixz, iyy, iyz, izz as written, along the inertial's own axes ``(6,)`` [kg·m²].
        step: half a unit of the last digit that the moments were written with [kg·m²].
        axes: the inertial's axes in the link's frame, ``(3, 3)``.
        pose: of the link in the root's frame with all joints at zero; None where the tree is broken.
        body: link that heads the rigid body which it is a part of.
        moves: whether a joint, or a free base, moves it.
    """

    name: str
    mass: float | None
    com: Array
    stated: Array
    step: float
    axes: Array
    pose: pin.SE3 | None
    body: str
    moves: bool

    @property
    def weighs(self) -> bool:
        """Whether it states a mass above zero."""
        return self.mass is not None and self.mass > 0.0

    @property
    def inertia(self) -> Array:
        """About the centre of mass, along the link's axes ``(3, 3)`` [kg·m²]."""
        return self.axes @ tensor(self.stated) @ self.axes.T


@dataclass(frozen=True, eq=False)
class DescribedJoint:
    """A joint that moves, with the limits that it states; None where it states none.

    Attributes:
        name: of the joint.
        kind: ``revolute``, ``continuous`` or ``prismatic``.
        parent: link that carries it.
        child: link that it carries.
        axis: in the child's frame, of length one ``(3,)``.
        lower: position limit [rad or m].
        upper: position limit [rad or m].
        effort: [N·m or N].
        velocity: [rad/s or m/s].
    """

    name: str
    kind: str
    parent: str
    child: str
    axis: Array
    lower: float | None
    upper: float | None
    effort: float | None
    velocity: float | None


class DescribedRobot:
    """What a URDF states of its links and joints.

    Args:
        root: the ``robot`` element.
        path: its file.
        floating: whether the base is free.
        thorough: whether meshes of looks are read for every link that needs them; else only where the collision
            geometry alone would make a link impossible.

    Attributes:
        links: by name, in the file's order.
        joints: those that move.
        faults: what could not be read.
        missing: meshes that are not there, by link.
    """

    def __init__(
        self, root: ElementTree.Element, path: Path, *, floating: bool = False, thorough: bool = True
    ) -> None:
        self.path, self.thorough = path, thorough
        self._elements = {e.get("name", ""): e for e in root.findall("link")}
        self.faults: list[Finding] = []
        self.missing: dict[str, list[str]] = {}
        self._solids: dict[tuple[str, str], list[Array]] = {}
        self._hulls: dict[tuple[str, ...], Solid | None] = {}
        self._meshes: dict[Path, Array | None] = {}
        self._has_read = False
        # Whether meshes with y up are meant to be turned.
        self._turns = False
        carriers = {link_at(joint, "child"): joint for joint in root.findall("joint")}
        self._parents = {child: link_at(joint, "parent") for child, joint in carriers.items()}
        self.joints = [self._joint(j) for j in root.findall("joint") if j.get("type") in MOVING]
        self.links = {name: self._link(name, e, carriers, floating) for name, e in self._elements.items()}
        for name in self.links:
            self._note_missing(name)

    def _numbers(
        self, element: ElementTree.Element, key: str, n: int, where: str, default: str | None
    ) -> Array | None:
        try:
            return np.array(read_numbers(element, key, n, self.path, where, default=default))
        except RobotError as error:
            place = where.split("/")[0].split(" ", 1)[1].strip("'")
            said = f"{str(error.field).partition('/')[2]} {error.what}"
            if said not in {fault.text for fault in self.faults}:
                self.faults.append(
                    Finding("bad_number", said, {}, (place,), "spoils", remedy=error.remedy or "")
                )
            return None

    def _joint(self, joint: ElementTree.Element) -> DescribedJoint:
        name, limit = joint.get("name", ""), joint.find("limit")
        stated: dict[str, float | None] = {}
        for key in ("lower", "upper", "effort", "velocity"):
            found = None
            if limit is not None and key in limit.attrib:
                found = self._numbers(limit, key, 1, f"joint {name!r}/limit", None)
            stated[key] = None if found is None else float(found[0])
        ends = link_at(joint, "parent"), link_at(joint, "child")
        stated_axis = joint.find("axis")
        axis = np.array([1.0, 0.0, 0.0])
        if stated_axis is not None:
            found = self._numbers(stated_axis, "xyz", 3, f"joint {name!r}/axis", None)
            axis = axis if found is None or not found.any() else found / np.linalg.norm(found)
        return DescribedJoint(name, str(joint.get("type")), *ends, axis, *stated.values())

    def _link(
        self, name: str, link: ElementTree.Element, carriers: dict[str, ElementTree.Element], floating: bool
    ) -> DescribedLink:
        head, pose, moves, seen = name, pin.SE3.Identity(), floating, {name}
        body: str | None = None
        broken = False
        while head in carriers:
            joint = carriers[head]
            fixed = joint.get("type") == "fixed"
            if not fixed:
                body, moves = body or head, True
            step = self._pose(joint.find("origin"), f"joint {joint.get('name')!r}/origin")
            broken, pose = broken or step is None, (step or pin.SE3.Identity()) * pose
            head = link_at(joint, "parent")
            if head in seen:
                broken = True
                break
            seen.add(head)
        stated = self._inertial(name, link)
        return DescribedLink(name, *stated, None if broken else pose, body or head, moves)

    def _pose(self, origin: ElementTree.Element | None, where: str) -> pin.SE3 | None:
        if origin is None:
            return pin.SE3.Identity()
        xyz, rpy = (self._numbers(origin, key, 3, where, "0 0 0") for key in ("xyz", "rpy"))
        return None if xyz is None or rpy is None else pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)

    def _inertial(self, name: str, link: ElementTree.Element) -> _Inertial:
        nothing = _Inertial(None, np.zeros(3), np.zeros(6), 0.0, np.eye(3))
        inertial, where = link.find("inertial"), f"link {name!r}/inertial"
        weight = None if inertial is None else inertial.find("mass")
        if inertial is None or weight is None:
            return nothing
        mass = self._numbers(weight, "value", 1, f"{where}/mass", None)
        pose = self._pose(inertial.find("origin"), f"{where}/origin")
        written = inertial.find("inertia")
        six = [
            None if written is None else self._numbers(written, key, 1, f"{where}/inertia", None)
            for key in MOMENTS
        ]
        if mass is None or pose is None or written is None or any(value is None for value in six):
            return nothing
        values = np.array([float(value[0]) for value in six if value is not None])
        step = (
            max(
                _half_digit(written.get(key, "")) for key, value in zip(MOMENTS, values, strict=True) if value
            )
            if values.any()
            else 0.0
        )
        return _Inertial(float(mass[0]), pose.translation.copy(), values, step, pose.rotation.copy())

    def _note_missing(self, link: str) -> None:
        for mesh in self._elements[link].iterfind(".//geometry/mesh"):
            name = mesh.get("filename", "").strip()
            if find_mesh(name, self.path) is None:
                self.missing.setdefault(link, []).append(name)

    def ancestors(self, link: str) -> set[str]:
        """A link and all above it in the tree."""
        found = set[str]()
        while link and link not in found:
            found.add(link)
            link = self._parents.get(link, "")
        return found

    def hull(self, link: str, *kinds: str) -> Solid | None:
        """Convex hull of a link's geometry of these kinds, ``collision`` or ``visual``; None where it has none."""
        key = (link, *kinds)
        if key not in self._hulls:
            self._hulls[key] = hull_of([points for kind in kinds for points in self._points(link, kind)])
        return self._hulls[key]

    @cached_property
    def mass(self) -> float:
        """Of all links [kg]."""
        return sum(link.mass or 0.0 for link in self.links.values())

    def bodies(self) -> Iterator[DescribedLink]:
        """Links that state a mass which counts."""
        return (link for link in self.links.values() if link.weighs and not self.is_weightless(link))

    def is_weightless(self, link: DescribedLink) -> bool:
        """Whether a link's share of the robot's mass is that of a frame."""
        return (link.mass or 0.0) < WEIGHTLESS * self.mass

    def own_hull(self, link: str) -> Solid | None:
        """Convex hull of a link's collision geometry, else, of a thorough view, of its looks; None without them."""
        found = self.hull(link, "collision")
        return self.hull(link, "visual") if found is None and self.thorough else found

    def hulls(self, link: str) -> Iterable[Solid]:
        """Hulls that the link may be, each with more in it: its collision geometry, with its looks, its whole body's.

        The last stands only for a link without geometry of its own, or holds what is mounted on it: what an earlier one
        forgives, a later one does too.
        """
        own = self.hull(link, "collision")
        if own is not None:
            yield own
        elif not self.thorough:
            return
        both = self.hull(link, "collision", "visual")
        if both is not None:
            yield both
        found = self.body_hull(link)
        if found is not None:
            yield found

    def body_hull(self, link: str) -> Solid | None:
        """Convex hull of all links of the link's rigid body, in its frame; None where they have no geometry."""
        key = (self.links[link].body, link, "body")
        if key not in self._hulls:
            here, points = self.links[link].pose, []
            for other in self.links.values():
                if here is not None and other.pose is not None and other.body == self.links[link].body:
                    move = here.actInv(other.pose)
                    for kind in ("collision", "visual"):
                        points += [
                            p @ move.rotation.T + move.translation for p in self._points(other.name, kind)
                        ]
            self._hulls[key] = hull_of(points)
        return self._hulls[key]

    def _points(self, link: str, kind: str) -> list[Array]:
        if (link, kind) not in self._solids:
            found = []
            for number, element in enumerate(self._elements[link].findall(kind)):
                points = self._solid(link, element, f"link {link!r}/{kind} {number}")
                if points is not None:
                    found.append(points)
            self._solids[link, kind] = found
        return self._solids[link, kind]

    def _solid(self, link: str, element: ElementTree.Element, where: str) -> Array | None:
        """Points around a solid in the link's frame; None where there is none or it cannot be read."""
        pose = self._pose(element.find("origin"), f"{where}/origin")
        geometry = element.find("geometry")
        solid = geometry[0] if geometry is not None and len(geometry) else None
        if pose is None or solid is None:
            return None
        try:
            corners = None
            if solid.tag == "mesh":
                file = find_mesh(solid.get("filename", "").strip(), self.path)
                corners = None if file is None else self._mesh(file, link)
                if corners is None:
                    return None
            points = outline(solid_shape(solid, corners, self.path, where))
        except (RobotError, ValueError) as error:
            said = error.what if isinstance(error, RobotError) else str(error)
            # A sheet is no body, and says nothing of one.
            if "plane" not in said:
                remedy = getattr(error, "remedy", None) or "correct its geometry"
                self.faults.append(
                    Finding("bad_geometry", f"{where} {said}", {}, (link,), "spoils", remedy=remedy)
                )
            return None
        return np.asarray(points @ pose.rotation.T + pose.translation)

    def _read_most(self) -> None:
        """Read in one go what is needed of every robot: meshes of the first kind of geometry that each link has."""
        shown: dict[str, list[ElementTree.Element]] = {"collision": [], "visual": []}
        for name, element in self._elements.items():
            kind = "visual" if self.thorough and element.find("collision") is None else "collision"
            if self.links[name].weighs and name not in self.missing:
                link = deepcopy(element)
                for mesh in link.iterfind(f"{kind}/geometry/mesh"):
                    mesh.set("filename", str(find_mesh(mesh.get("filename", "").strip(), self.path)))
                shown[kind].append(link)
        for kind, links in shown.items():
            meshes = (mesh for link in links for mesh in link.iterfind(f"{kind}/geometry/mesh"))
            try:
                points = read_meshes(Path(mesh.get("filename", "")) for mesh in meshes)
                meant = turn_upright(links, kind, points)
            except (RobotError, ValueError):
                # One by one, so that what is damaged is named.
                continue
            self._turns = self._turns or meant is not points
            self._meshes.update(meant)

    def _mesh(self, file: Path, link: str) -> Array | None:
        if not self._has_read:
            self._has_read = True
            self._read_most()
        if file not in self._meshes:
            try:
                points = read_meshes([file])[file]
                self._meshes[file] = turn_file_upright(file, points) if self._turns else points
            except RobotError as error:
                self._meshes[file] = None
                said = f"{file.name} {error.what}"
                self.faults.append(
                    Finding("bad_mesh", said, {}, (link,), "limits", remedy=error.remedy or "")
                )
        return self._meshes[file]


def tensor(six: Array) -> Array:
    """Symmetric matrix of ixx, ixy, ixz, iyy, iyz, izz."""
    xx, xy, xz, yy, yz, zz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def hull_of(parts: list[Array]) -> Solid | None:
    """The convex hull of points; None of none, and of points in a plane."""
    from scipy.spatial import ConvexHull, QhullError

    if not parts:
        return None
    points = np.concatenate(parts)
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return None
    return Solid(points[hull.vertices], np.unique(hull.equations.round(9), axis=0), float(hull.volume))


def outline(shape: Shape) -> Array:
    """Points whose hull contains a solid and is at most a thirtieth wider, in the solid's frame ``(n, 3)`` [m]."""
    if shape.vertices is not None:
        return shape.vertices
    if shape.kind == "box":
        return np.asarray(0.5 * CORNERS * np.array(shape.size))
    # A polygon around the circle.
    radius = shape.size[0] / np.cos(np.pi / len(_ROUND))
    ring = radius * np.column_stack([np.cos(_ROUND), np.sin(_ROUND)])
    levels = [(-0.5 * shape.size[-1], 1.0), (0.5 * shape.size[-1], 1.0)]
    if shape.kind in {"sphere", "capsule"}:
        half = 0.0 if shape.kind == "sphere" else 0.5 * shape.size[1]
        angles = np.linspace(0.0, 0.5 * np.pi, 5)
        levels = [(side * (half + radius * np.sin(a)), np.cos(a)) for side in (-1, 1) for a in angles]
    return np.concatenate(
        [np.column_stack([share * ring, np.full(len(ring), height)]) for height, share in levels]
    )


def _half_digit(text: str) -> float:
    """Half a unit of the last digit that a number is written with."""
    mantissa, _, exponent = text.strip().lower().partition("e")
    _, point, decimals = mantissa.partition(".")
    return 0.5 * 10.0 ** (int(exponent or 0) - len(decimals)) if point or exponent else 0.0
