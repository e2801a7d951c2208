"""Links and joints of a model as its file states them: what can be read is, what cannot becomes a finding.

The strict reader stops at the first fault. To judge a description all of it has to be seen, so nothing here raises for
a number, a mesh or a joint that is wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import RobotError
from excite.finding import Finding
from excite.robot.shapes.collision import turn_upright
from excite.robot.shapes.link_shapes import hull_faces, solid_shape
from excite.robot.shapes.mesh_files import read_meshes
from excite.robot.shapes.shape import Shape, coal_geometry, outline_points, place_points
from excite.robot.urdf.inertia import WEIGHTLESS, Inertial, read_inertial
from excite.robot.urdf.numbers import read_number, read_numbers, read_origin
from excite.robot.urdf.reading import absolute_meshes
from excite.robot.urdf.tree import MOVING, LinkTree, link_at
from excite.robot.urdf.writing import MOMENTS

Value = TypeVar("Value")


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
    def spread(self) -> Array:
        """Covariance ``(3, 3)`` [m²] of a body of even density in it."""
        used, faces = hull_faces(self.points)
        hull = Shape("", "", 0, pin.SE3.Identity(), "convex", vertices=self.points[used], faces=faces)
        body = coal_geometry(hull)
        moments = np.asarray(body.computeMomentofInertiaRelatedToCOM()) / body.computeVolume()
        return np.asarray(0.5 * np.trace(moments) * np.eye(3) - moments)

    def distance_outside(self, point: Array) -> float:
        """How far outside a point is, at least [m]; negative inside."""
        return float((self.planes[:, :3] @ point + self.planes[:, 3]).max())

    def nearest_point(self, point: Array) -> Array:
        """The point of the body nearest to one outside: the mean of its corners by weights of least squares."""
        from scipy.optimize import nnls

        # The weights' sum is held at one by a row that outweighs the rest a million times.
        heavy = 1e3 * self.size
        rows = np.vstack([(self.points - point).T, np.full(len(self.points), heavy)])
        weights, _ = nnls(rows, np.array([0.0, 0.0, 0.0, heavy]))
        return np.asarray(weights @ self.points / weights.sum())


@dataclass(frozen=True, eq=False)
class DescribedLink(Inertial):
    """A link with its inertial as stated; mass and moments are zero where none can be read.

    Attributes:
        name: of the link.
        pose: of the link in the root's frame with all joints at zero; None where the tree is broken.
        body: link that heads the rigid body which it is a part of.
        step: half a unit of the last digit that the moments were written with [kg·m²].
    """

    name: str = ""
    pose: pin.SE3 | None = None
    body: str = ""
    step: float = 0.0

    @property
    def weight(self) -> float:
        """Its mass, 0 where it states none above zero [kg]."""
        return max(self.mass, 0.0)


@dataclass(frozen=True, eq=False)
class DescribedJoint:
    """A joint that moves, with the limits that it states.

    Attributes:
        name: of the joint.
        kind: ``revolute``, ``continuous`` or ``prismatic``.
        child: link that it carries.
        axis: in the child's frame, of length one ``(3,)``.
        limits: ``lower``, ``upper`` [rad or m], ``effort`` [N·m or N] and ``velocity`` [rad/s or m/s] where stated.
    """

    name: str
    kind: str
    child: str
    axis: Array
    limits: dict[str, float]


class DescribedRobot:
    """What a URDF states of its links and joints.

    Args:
        root: the ``robot`` element, in which meshes that are found get their whole path.
        path: its file.
        shaped: links whose shapes are authored elsewhere.
        thorough: whether meshes of looks are read for every link that needs them; else only where the collision
            geometry alone would make a link impossible.

    Attributes:
        links: by name, in the file's order.
        joints: those that move.
        tree: which joints carry which links.
        faults: what could not be read.
        missing: meshes that are not there, by link.
    """

    def __init__(
        self, root: Element, path: Path, shaped: frozenset[str] = frozenset(), *, thorough: bool = True
    ) -> None:
        self.path, self.shaped, self.thorough = path, shaped, thorough
        self._elements = {e.get("name", ""): e for e in root.findall("link")}
        self._joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
        self.faults: list[Finding] = []
        self.missing = {
            name: lost for name, e in self._elements.items() if (lost := absolute_meshes(e, path))
        }
        self._hulls: dict[tuple[str, ...], Solid | None] = {}
        self._solids: dict[tuple[str, str], list[Array]] = {}
        self._meshes: dict[Path, Array] = {}
        self._tried: set[str] = set()
        self.tree = LinkTree(self._joints)
        self.joints = [self._read_joint(j) for j in self._joints.values() if j.get("type") in MOVING]
        self.links = {name: self._read_link(name, e) for name, e in self._elements.items()}

    def _say_finding(self, kind: str, text: str, place: str, severity: Any, remedy: str | None) -> None:
        if text not in {fault.text for fault in self.faults}:
            self.faults.append(Finding(kind, text, {}, (place,), severity, remedy=remedy or ""))

    def _read_part(self, read: Callable[..., Value], element: Element, *arguments: Any) -> Value | None:
        """What a strict reader reads below an element; None where that says a number is wrong, which is a finding."""
        try:
            return read(element, *arguments)
        except RobotError as error:
            place, _, said = str(error.field).partition("/")
            # What is missing or stands twice the strict reader refuses for the whole file.
            if "@" in said:
                text = f"{said} {error.what}"
                self._say_finding("bad_number", text, place.split("'")[1], "spoils", error.remedy)
            return None

    def _read_joint(self, joint: Element) -> DescribedJoint:
        limit, name = joint.find("limit"), joint.get("name", "")
        stated = {
            key: self._read_part(read_number, limit, key, self.path, f"joint {name!r}/limit")
            for key in ("lower", "upper", "effort", "velocity")
            if limit is not None and key in limit.keys()
        }
        axis = joint.find("axis")
        read = (
            None
            if axis is None
            else self._read_part(read_numbers, axis, "xyz", 3, self.path, f"joint {name!r}/axis")
        )
        found = np.array(read or (1.0, 0.0, 0.0))
        direction = found / np.linalg.norm(found) if found.any() else np.eye(3)[0]
        known: dict[str, float] = {key: value for key, value in stated.items() if value is not None}
        return DescribedJoint(name, str(joint.get("type")), link_at(joint, "child"), direction, known)

    def _read_link(self, name: str, link: Element) -> DescribedLink:
        head, body = name, ""
        pose: pin.SE3 | None = pin.SE3.Identity()
        for above in self.tree.above(name):
            joint = self._joints[above]
            step = self._read_part(read_origin, joint, self.path, f"joint {above!r}")
            pose = None if step is None or pose is None else step * pose
            body = body or (head if joint.get("type") != "fixed" else "")
            head = self.tree.ends[above][0]
        # A circle has no root.
        pose = None if head in self.tree.carriers else pose
        own, written = (
            self._read_part(read_inertial, link, self.path) or Inertial(),
            link.find("inertial/inertia"),
        )
        texts = [] if written is None else [written.get(key, "") for key in MOMENTS]
        steps = [_half_digit(text) for text, value in zip(texts, own.stated, strict=False) if value]
        return DescribedLink(
            own.mass, own.centre, own.stated, own.axes, name, pose, body or head, max(steps, default=0.0)
        )

    @cached_property
    def mass(self) -> float:
        """Of all links [kg]."""
        return sum(link.mass for link in self.links.values())

    def weighty_links(self) -> Iterator[DescribedLink]:
        """Links that state a mass which counts."""
        return (link for link in self.links.values() if link.weight and not self.is_weightless(link))

    def is_weightless(self, link: DescribedLink) -> bool:
        """Whether a link's share of the robot's mass is that of a frame."""
        return link.mass < WEIGHTLESS * self.mass

    def own_hull(self, link: str) -> Solid | None:
        """Convex hull of a link's collision geometry, else, of a thorough view, of its looks; None without them."""
        found = self._hull_of(link, "collision")
        return self._hull_of(link, "visual") if found is None and self.thorough else found

    def link_hulls(self, link: str) -> Iterable[Solid]:
        """Hulls that the link may be, each with more in it: its collision geometry, with its looks, its whole body's.

        The last stands only for a link without geometry of its own, or holds what is mounted on it: what an earlier one
        forgives, a later one does too.
        """
        for kinds in (("collision",), ("collision", "visual"), ("collision", "visual", "body")):
            found = self._hull_of(link, *kinds)
            if found is not None:
                yield found
            elif not self.thorough and len(kinds) == 1:
                return

    def first_hull(self, link: str) -> Solid | None:
        """The first of :meth:`hulls`."""
        return next(iter(self.link_hulls(link)), None)

    def _hull_of(self, link: str, *kinds: str) -> Solid | None:
        """Convex hull of a link's geometry of some kinds, with ``body`` of all links of its rigid body."""
        if (link, *kinds) not in self._hulls:
            here, points = self.links[link], list[Array]()
            for other in self.links.values() if "body" in kinds else [here]:
                move = pin.SE3.Identity() if other is here else None
                if (
                    move is None
                    and other.body == here.body
                    and here.pose is not None
                    and other.pose is not None
                ):
                    move = here.pose.actInv(other.pose)
                for kind in kinds if move is not None else ():
                    points += [place_points(one, move) for one in self._points_of(other.name, kind)]
            self._hulls[(link, *kinds)] = hull_of(points)
        return self._hulls[(link, *kinds)]

    def _points_of(self, link: str, kind: str) -> list[Array]:
        """Points around each solid of a kind, in the link's frame; without those that cannot be read."""
        if (link, kind) not in self._solids:
            found = self._solids[link, kind] = []
            for number, element in enumerate(self._elements[link].findall(kind)):
                where = f"link {link!r}/{kind} {number}"
                pose = self._read_part(read_origin, element, self.path, where)
                solid = next(element.iterfind("geometry/*"), None)
                if pose is None or solid is None:
                    continue
                corners = (
                    self._mesh_corners(solid.get("filename", ""), link, kind) if solid.tag == "mesh" else None
                )
                if solid.tag == "mesh" and corners is None:
                    continue
                try:
                    shape = solid_shape(solid, corners, self.path, where)
                    found.append(place_points(outline_points(shape), pose))
                except (RobotError, ValueError) as error:
                    said = error.what if isinstance(error, RobotError) else str(error)
                    # A sheet is no body, and says nothing of one.
                    if "plane" not in said:
                        remedy = getattr(error, "remedy", None) or "correct its geometry"
                        self._say_finding("bad_geometry", f"{where} {said}", link, "spoils", remedy)
        return self._solids[link, kind]

    def _mesh_corners(self, name: str, link: str, kind: str) -> Array | None:
        """Corners of a mesh, None of what is not there or damaged; with the first of a kind all that links need of it
        are read."""
        file = Path(name)
        if not name or name in self.missing.get(link, ()):
            return None
        if file not in self._meshes:
            first = [one for one in self._elements if kind not in self._tried and self._is_shown(one, kind)]
            self._tried.add(kind)
            owners = {
                Path(mesh.get("filename", "")): one
                for one in {**dict.fromkeys(first), link: None}
                for mesh in self._elements[one].iterfind(f"{kind}/geometry/mesh")
                if mesh.get("filename") not in self.missing.get(one, ())
            }
            faults: dict[Path, RobotError] = {}
            points = read_meshes(owners, faults)
            for damaged, error in faults.items():
                text = f"{damaged.name} {error.what}"
                self._say_finding("bad_mesh", text, owners[damaged], "limits", error.remedy)
            links = [self._elements[one] for one in dict.fromkeys(owners.values())]
            self._meshes |= dict.fromkeys(faults, np.zeros((0, 3))) | dict(turn_upright(links, kind, points))
        corners = self._meshes[file]
        return corners if len(corners) else None

    def _is_shown(self, link: str, kind: str) -> bool:
        """Whether a link's geometry of a kind is the first that it has, and is all there."""
        bare = self.thorough and self._elements[link].find("collision") is None
        shown = "visual" if bare else "collision"
        return kind == shown and link not in self.missing and self.links[link].weight > 0.0


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


def _half_digit(text: str) -> float:
    """Half a unit of the last digit that a number is written with."""
    mantissa, _, exponent = text.strip().lower().partition("e")
    _, point, decimals = mantissa.partition(".")
    return 0.5 * 10.0 ** (int(exponent or 0) - len(decimals)) if point or exponent else 0.0
