"""Pairs of bodies that are near each other: nearest points, distances, and their gradients in the joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.regressor.kernels import Placements, forward_kinematics
from excite.regressor.tree import PRISMATIC, read_tree
from excite.robot.robot import Robot
from excite.robot.shapes.collision import (
    TABLE,
    bounding_balls,
    collision_shapes,
    geometry_data,
    watched_model,
)
from excite.robot.shapes.shape import Shape

# Decimals of coal's distances and nearest points [m] and normals, as of pair_distance in excite.robot.shapes.collision:
# the last bits depend on what a process did before, and what a search makes of them is another motion.
_DIGITS = 7


@dataclass(frozen=True, eq=False)
class NearPairs:
    """Pairs that are near each other at some samples, ``m`` of them.

    Attributes:
        sample: ``(m,)``.
        pair: ``(m,)``.
        distance: ``(m,)`` [m].
        first: ``(m, 3)`` nearest point of the first body's surface, world frame [m].
        second: ``(m, 3)`` of the second.
        normal: ``(m, 3)`` unit vector from the first to the second.
    """

    sample: NDArray[np.intp]
    pair: NDArray[np.intp]
    distance: Array
    first: Array
    second: Array
    normal: Array


class NearBodies:
    """Finds pairs of bodies that are near each other, of those that some joints move relative to each other.

    Capsules and spheres are computed here, all samples at once, the table as the half-space below its top; other
    shapes by coal.

    Args:
        robot: the robot.
        joints: model joints that move, ``(n_moved,)``.

    Attributes:
        kept: distance that each pair has to keep, ``(n_pairs,)`` [m].
    """

    def __init__(self, robot: Robot, joints: NDArray[np.intp]) -> None:
        self._tree, self._model, self._data = read_tree(robot.model), robot.model, robot.model.createData()
        self._geometry, kept = watched_model(robot)
        self._state = geometry_data(self._geometry)
        self._joints = joints
        shapes = collision_shapes(robot)
        self._parents = np.array([int(shape.joint) for shape in shapes])
        self._axes = _Axes(shapes)
        centres, self._radii = bounding_balls(self._geometry)
        items = zip(self._geometry.geometryObjects, centres, strict=True)
        self._centres = np.array([item.placement.act(centre) for item, centre in items])
        pairs = [(pair.first, pair.second) for pair in self._geometry.collisionPairs]
        every = np.array(pairs, dtype=int).reshape(-1, 2)
        self._above = np.array([np.isin(joints, list(robot.model.supports[int(j)])) for j in self._parents])
        mattering = (self._above[every[:, 0]] != self._above[every[:, 1]]).any(axis=1)
        self._pairs, self._index, self.kept = every[mattering], np.flatnonzero(mattering), kept[mattering]

    def find(self, q: Array, within: Array) -> tuple[Placements, NearPairs]:
        """Poses of the joints in configurations ``(n, nq)``, and pairs nearer than ``within`` ``(n_pairs,)`` [m]."""
        poses = forward_kinematics(self._tree, q)
        rotation, translation = poses.rotation[:, self._parents], poses.translation[:, self._parents]
        centres = np.einsum("nbij,bj->nbi", rotation, self._centres) + translation
        first, second = self._pairs.T
        gap = (
            np.linalg.norm(centres[:, first] - centres[:, second], axis=2)
            - self._radii[first]
            - self._radii[second]
        )
        sample, pair = np.nonzero(gap < within)
        simple = self._axes.simple[first[pair]] & self._axes.simple[second[pair]]
        parts = [self._by_segments(rotation, translation, sample[simple], pair[simple])]
        parts.append(self._by_coal(q, sample[~simple], pair[~simple]))
        near = [part.distance < within[part.pair] for part in parts]
        fields = ("sample", "pair", "distance", "first", "second", "normal")
        joined = {
            name: np.concatenate([getattr(part, name)[keep] for part, keep in zip(parts, near, strict=True)])
            for name in fields
        }
        return poses, NearPairs(**joined)

    def carriers(self, near: NearPairs) -> NDArray[np.intp]:
        """Model joints that carry the bodies of pairs, ``(m, 2)``."""
        return np.asarray(self._parents[self._pairs[near.pair]])

    def slopes(self, poses: Placements, near: NearPairs) -> Array:
        """Gradients of distances in the moved joints, ``(m, n_moved)``: how nearest points part along the normal."""
        tree, joints = self._tree, self._joints
        origin = poses.translation[near.sample][:, joints]
        axis = np.einsum("mjab,jb->mja", poses.rotation[near.sample][:, joints], tree.axes[joints])
        slope = np.zeros((len(near.sample), len(joints)))
        for points, body, sign in ((near.first, 0, -1.0), (near.second, 1, 1.0)):
            arm = np.cross(axis, points[:, None, :] - origin)
            arm[:, tree.kinds[joints] == PRISMATIC] = axis[:, tree.kinds[joints] == PRISMATIC]
            carried = self._above[self._pairs[near.pair][:, body]]
            slope += sign * carried * np.einsum("mja,ma->mj", arm, near.normal)
        return slope

    def _by_segments(
        self, rotation: Array, translation: Array, sample: NDArray[np.intp], pair: NDArray[np.intp]
    ) -> NearPairs:
        """Capsules, spheres and the table."""
        ends = []
        for body in self._pairs[pair].T:
            for local in (self._axes.start, self._axes.end):
                turned = np.einsum("mij,mj->mi", rotation[sample, body], local[body])
                ends.append(turned + translation[sample, body])
        first, second = self._pairs[pair].T
        one, two = closest_points(*ends)
        for table, points, others in ((first, one, ends[2:]), (second, two, ends[:2])):
            flat = self._axes.table[table]
            lowest = np.where((others[0][:, 2] < others[1][:, 2])[:, None], others[0], others[1])
            top = np.column_stack([lowest[:, :2], np.full(len(lowest), self._axes.top)])
            points[flat] = top[flat]
            (two if points is one else one)[flat] = lowest[flat]
        way = two - one
        length = np.linalg.norm(way, axis=1)
        normal = way / np.maximum(length, 1e-9)[:, None]
        # Below the table's top the way points down, and the distance is negative.
        under = (self._axes.table[first] & (way[:, 2] < 0)) | (self._axes.table[second] & (way[:, 2] > 0))
        sign = np.where(under, -1.0, 1.0)
        normal = sign[:, None] * normal
        radii = self._axes.radius[first], self._axes.radius[second]
        distance = sign * length - radii[0] - radii[1]
        # From the axes to the surfaces.
        one, two = one + radii[0][:, None] * normal, two - radii[1][:, None] * normal
        return NearPairs(sample, pair, distance, one, two, normal)

    def _by_coal(self, q: Array, sample: NDArray[np.intp], pair: NDArray[np.intp]) -> NearPairs:
        distance, points = np.empty(len(sample)), np.empty((3, len(sample), 3))
        at = -1
        for i, (t, k) in enumerate(zip(sample, self._index[pair], strict=True)):
            if t != at:
                pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._state, q[t])
                at = t
            found = pin.computeDistance(self._geometry, self._state, int(k))
            distance[i] = found.min_distance
            points[0, i], points[1, i] = found.getNearestPoint1(), found.getNearestPoint2()
            points[2, i] = found.normal
        return NearPairs(sample, pair, distance.round(_DIGITS), *points.round(_DIGITS))


class _Axes:
    """Capsules and spheres as segments with a radius, in the frames of their joints."""

    def __init__(self, shapes: tuple[Shape, ...]) -> None:
        n = len(shapes)
        self.start, self.end, self.radius = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n)
        self.table = np.array([shape.link == TABLE for shape in shapes])
        self.simple = self.table | np.array([shape.kind in ("capsule", "sphere") for shape in shapes])
        self.top = 0.0
        for i, shape in enumerate(shapes):
            if shape.link == TABLE:
                self.top = float(shape.placement.translation[2] + 0.5 * shape.size[2])
            elif self.simple[i]:
                half = 0.5 * shape.size[1] if shape.kind == "capsule" else 0.0
                self.start[i] = shape.placement.act(np.array([0.0, 0.0, -half]))
                self.end[i] = shape.placement.act(np.array([0.0, 0.0, half]))
                self.radius[i] = shape.size[0]


# Nearest points of segments, many pairs at once.

# Squared sine below which two segments count as parallel.
_PARALLEL = 1e-12


def closest_points(p0: Array, p1: Array, q0: Array, q1: Array) -> tuple[Array, Array]:
    """Nearest points of segments ``p0 p1`` and ``q0 q1`` (Ericson 2005, section 5.1.9), ``(m, 3)`` each."""
    d1, d2, r = p1 - p0, q1 - q0, p0 - q0
    a, e = np.einsum("mi,mi->m", d1, d1), np.einsum("mi,mi->m", d2, d2)
    b, c, f = (np.einsum("mi,mi->m", x, y) for x, y in ((d1, d2), (d1, r), (d2, r)))
    safe_a, safe_e = np.where(a > 0.0, a, 1.0), np.where(e > 0.0, e, 1.0)
    cross = a * e - b * b
    skew = cross > _PARALLEL * a * e
    s = np.where(skew, np.clip((b * f - c * e) / np.where(skew, cross, 1.0), 0.0, 1.0), 0.0)
    t = np.where(e > 0.0, (b * s + f) / safe_e, 0.0)
    clipped = np.clip(t, 0.0, 1.0)
    # Where the second parameter was clipped, or the second segment is a point, the first follows from it.
    again = np.where(a > 0.0, np.clip((b * clipped - c) / safe_a, 0.0, 1.0), 0.0)
    s = np.where((t != clipped) | (e == 0.0), again, s)
    return p0 + s[:, None] * d1, q0 + clipped[:, None] * d2
