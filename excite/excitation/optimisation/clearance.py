"""Distances between a robot's bodies over time as smooth constraints, with their gradients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.excitation.optimisation.objective import Layout, Sampling
from excite.excitation.optimisation.segments import closest_points
from excite.regressor.kernels import Placements, forward_kinematics
from excite.regressor.tree import PRISMATIC, read_tree
from excite.robot.shapes.collision import TABLE, collision_shapes, geometry_data, watched_model
from excite.robot.shapes.shape import Shape

# Pairs farther apart than this beyond the margin do not enter [m].
_NEAR = 0.1
# The smooth minimum over time is at most log(n)/SHARPNESS below the minimum [1/m].
_SHARPNESS = 1000.0


@dataclass(frozen=True, eq=False)
class _Close:
    """Pairs that are near each other at some samples, ``m`` of them.

    Attributes:
        sample: ``(m,)``.
        pair: ``(m,)``.
        distance: ``(m,)`` [m].
        first: ``(m, 3)`` nearest point of the first body, world frame [m].
        second: ``(m, 3)`` of the second.
        normal: ``(m, 3)`` unit vector from the first to the second.
    """

    sample: NDArray[np.intp]
    pair: NDArray[np.intp]
    distance: Array
    first: Array
    second: Array
    normal: Array


class Clearance:
    """For each pair of bodies the smooth minimum of its distance over time, less what is required.

    The smooth minimum ``-log Σ exp(-ρ d)/ρ`` never exceeds the minimum, so that a motion that satisfies it is
    free at the samples. Capsules and spheres are computed here, all samples at once, the table as the half-space
    below its top; other shapes by coal.

    Args:
        layout: what the variables stand for.
        time: ``(n,)`` at which distances are taken [s].
        extra: distance beyond the robot's collision margin [m]; pairs that keep less than that keep no more.
    """

    def __init__(self, layout: Layout, time: Array, extra: float) -> None:
        robot = layout.robot
        self._sampling, self._tree = Sampling(layout, time), read_tree(robot.model)
        self._model, self._data = robot.model, robot.model.createData()
        self._geometry, kept = watched_model(robot)
        self._state = geometry_data(self._geometry)
        self._joints = layout.joints + (2 if robot.floating else 1)
        shapes = collision_shapes(robot)
        self._parents = np.array([int(shape.joint) for shape in shapes])
        self._axes = _Axes(shapes)
        spheres = [_bounding_sphere(item) for item in self._geometry.geometryObjects]
        self._centres, self._radii = np.array([c for c, _ in spheres]), np.array([r for _, r in spheres])
        pairs = [(pair.first, pair.second) for pair in self._geometry.collisionPairs]
        self._pairs = np.array(pairs, dtype=int).reshape(-1, 2)
        above = np.array([np.isin(self._joints, list(robot.model.supports[int(j)])) for j in self._parents])
        mattering = (above[self._pairs[:, 0]] != above[self._pairs[:, 1]]).any(axis=1)
        self._pairs, self._index = self._pairs[mattering], np.flatnonzero(mattering)
        self._above = above
        self._required = (kept + np.where(kept < robot.description.collision.margin, 0.0, extra))[mattering]
        self.n_pairs = len(self._pairs)

    def smooth(self, x: Array) -> tuple[Array, Array]:
        """Smooth minimum of each pair's clearance ``(n_pairs,)`` [m] and its gradient ``(n_pairs, size)``."""
        poses, close = self._close(x)
        value = close.distance - self._required[close.pair]
        least = np.full(self.n_pairs, _NEAR)
        np.minimum.at(least, close.pair, value)
        weight = np.exp(-_SHARPNESS * (value - least[close.pair]))
        total = np.bincount(close.pair, weights=weight, minlength=self.n_pairs)
        # What is not near weighs as much as at the edge, so that the minimum does not jump when a pair comes near.
        n = len(self._sampling.time)
        count = np.bincount(close.pair, minlength=self.n_pairs)
        total += (n - count) * np.exp(-_SHARPNESS * (_NEAR - least))
        smooth = least - np.log(total) / _SHARPNESS
        pull = (weight / total[close.pair])[:, None] * self._slopes(poses, close)
        by_offset = np.zeros((self.n_pairs, len(self._joints)))
        np.add.at(by_offset, close.pair, pull)
        basis = self._sampling.bases[0]
        by_table = np.zeros((self.n_pairs, len(self._joints), basis.shape[1]))
        np.add.at(by_table, close.pair, pull[:, :, None] * basis[close.sample][:, None, :])
        return smooth, self._sampling.layout.gathered(by_offset, by_table)

    def least(self, x: Array) -> float:
        """Smallest clearance at the samples [m], at most 0.1."""
        close = self._close(x)[1]
        return float((close.distance - self._required[close.pair]).min(initial=_NEAR))

    def _close(self, x: Array) -> tuple[Placements, _Close]:
        q = self._sampling.whole(x).q
        poses = forward_kinematics(self._tree, q)
        rotation, translation = poses.rotation[:, self._parents], poses.translation[:, self._parents]
        centres = np.einsum("nbij,bj->nbi", rotation, self._centres) + translation
        first, second = self._pairs.T
        gap = (
            np.linalg.norm(centres[:, first] - centres[:, second], axis=2)
            - self._radii[first]
            - self._radii[second]
        )
        sample, pair = np.nonzero(gap < self._required + _NEAR)
        simple = self._axes.simple[first[pair]] & self._axes.simple[second[pair]]
        parts = [self._by_segments(rotation, translation, sample[simple], pair[simple])]
        parts.append(self._by_coal(q, sample[~simple], pair[~simple]))
        near = [part.distance < self._required[part.pair] + _NEAR for part in parts]
        fields = ("sample", "pair", "distance", "first", "second", "normal")
        joined = {
            name: np.concatenate([getattr(part, name)[keep] for part, keep in zip(parts, near, strict=True)])
            for name in fields
        }
        return poses, _Close(**joined)

    def _by_segments(
        self, rotation: Array, translation: Array, sample: NDArray[np.intp], pair: NDArray[np.intp]
    ) -> _Close:
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
        distance = sign * length - self._axes.radius[first] - self._axes.radius[second]
        return _Close(sample, pair, distance, one, two, sign[:, None] * normal)

    def _by_coal(self, q: Array, sample: NDArray[np.intp], pair: NDArray[np.intp]) -> _Close:
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
        return _Close(sample, pair, distance, *points)

    def _slopes(self, poses: Placements, close: _Close) -> Array:
        """Gradients of distances in the moved joints, ``(m, n_moved)``: how nearest points part along the normal."""
        tree, joints = self._tree, self._joints
        origin = poses.translation[close.sample][:, joints]
        axis = np.einsum("mjab,jb->mja", poses.rotation[close.sample][:, joints], tree.axes[joints])
        slope = np.zeros((len(close.sample), len(joints)))
        for points, body, sign in ((close.first, 0, -1.0), (close.second, 1, 1.0)):
            arm = np.cross(axis, points[:, None, :] - origin)
            arm[:, tree.kinds[joints] == PRISMATIC] = axis[:, tree.kinds[joints] == PRISMATIC]
            carried = self._above[self._pairs[close.pair][:, body]]
            slope += sign * carried * np.einsum("mja,ma->mj", arm, close.normal)
        return slope


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


def _bounding_sphere(item: pin.GeometryObject) -> tuple[Array, float]:
    item.geometry.computeLocalAABB()
    return item.placement.act(item.geometry.aabb_center), float(item.geometry.aabb_radius)
