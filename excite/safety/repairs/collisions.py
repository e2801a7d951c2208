"""A fast search for self-collisions along a path, used by repairs; the verdict has its own."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.robot.robot import Robot
from excite.robot.shapes.collision import geometry_data, pair_distance, watched_model

# Distance beyond the required margin that repairs keep, so that nothing happens between their samples [m].
EXTRA = 0.004
# Pairs that rest close together get this share of their spare distance as extra instead.
_SHARE = 0.25


# Postures of a path among which the worst is looked for.
_LOOKED_AT = 40


class TooClose(NamedTuple):
    """Two bodies.

    Attributes:
        pair: ``LINK - LINK``.
        distance: between them [m].
        required: what it has to be [m].
        posture: in which they are so near ``(nq,)``.
    """

    pair: str
    distance: float
    required: float
    posture: Array


class CollisionProbe:
    """Finds the first configuration in which two bodies are closer than the robot's collision margin allows."""

    def __init__(self, robot: Robot) -> None:
        self._model = robot.model
        self._data = robot.model.createData()
        geometry, kept = watched_model(robot)
        self._geometry = geometry.copy()
        self._state = geometry_data(self._geometry)
        self._set_margins(robot, kept)
        # Of a few dozen bodies, boxes about all pairs are compared sooner than a tree of boxes is brought up to date: a
        # posture of a G1 takes 31 us (with the tree 39), of a UR10 4 (9), of a Talos 50 (55).
        self._manager = pin.BroadPhaseManager_NaiveCollisionManager(self._model, self._geometry, self._state)

    def _set_margins(self, robot: Robot, kept: Array) -> None:
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._state, robot.rest)
        for k, margin in enumerate(kept.tolist()):
            distance = pair_distance(self._geometry, self._state, k)
            extra = min(EXTRA, _SHARE * max(0.0, distance - margin))
            self._state.collisionRequests[k].security_margin = margin + extra

    def collides(self, q: Array) -> bool:
        """Whether one configuration ``(nq,)`` comes too close."""
        return bool(pin.computeCollisions(self._model, self._data, self._manager, q, True))

    def first(self, q: Array) -> int | None:
        """Row of the first of configurations ``(n, nq)`` that comes too close, None if none does."""
        for i, row in enumerate(q):
            if self.collides(row):
                return i
        return None

    def closest(self, q: Array) -> TooClose:
        """The two bodies that lack most of their distance in the first of configurations ``(n, nq)``, and how close
        they come: of the others forty at most are looked at."""
        self._place(q[0])
        lacking = [
            pair_distance(self._geometry, self._state, k) - self._state.collisionRequests[k].security_margin
            for k in range(len(self._geometry.collisionPairs))
        ]
        k = int(np.argmin(lacking))
        pair = self._geometry.collisionPairs[k]
        names = (self._geometry.geometryObjects[i].name for i in (pair.first, pair.second))
        where = " - ".join(name.rsplit("_", 1)[0] for name in names)
        rows = np.unique(np.linspace(0, len(q) - 1, _LOOKED_AT).round().astype(int))
        distance = np.empty(len(rows))
        for i, row in enumerate(q[rows]):
            self._place(row)
            distance[i] = pair_distance(self._geometry, self._state, k)
        worst = int(np.argmin(distance))
        required = float(self._state.collisionRequests[k].security_margin)
        return TooClose(where, float(distance[worst]), required, q[rows[worst]])

    def _place(self, q: Array) -> None:
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._state, q)


# A way for the joints round the robot's own bodies: RRT-Connect (Kuffner and LaValle 2000) and shortcuts.

# Postures looked at along a line are this far apart in the joint that moves most [rad or m]. A finer step would find
# more of what the check refuses afterwards, between its samples too: of 12 ways of two arms from rest to drawn
# postures, round their own bodies, it refused none.
_STEP = 0.04
# Length of a branch [rad or m], and branches of both trees after which the search ends: some seconds.
_BRANCH, _BRANCHES = 0.4, 3000
_SHORTCUTS = 60


def is_straight_free(robot: Robot, probe: CollisionProbe, start: Array, end: Array) -> bool:
    """Whether the joints may go on a straight line, ``(n_joints,)`` each; the base is at rest."""
    n = 2 + int(np.ceil(np.abs(end - start).max() / _STEP))
    q = np.tile(robot.rest, (n, 1))
    q[:, robot.n_base_q :] = start + np.linspace(0.0, 1.0, n)[:, None] * (end - start)
    return probe.first(q) is None


def find_route(robot: Robot, start: Array, end: Array, rng: np.random.Generator) -> list[Array] | None:
    """Postures from ``start`` to ``end``, both included, between which the joints may go straight.

    Args:
        robot: the robot; its base is at rest.
        start: ``(n_joints,)`` [rad or m].
        end: ``(n_joints,)`` [rad or m].
        rng: of the postures that are tried.

    Returns:
        The postures; None where no way was found.
    """
    probe = CollisionProbe(robot)
    if is_straight_free(robot, probe, start, end):
        return [start, end]
    for posture in (start, end):
        if not is_straight_free(robot, probe, posture, posture):
            return None
    found = _search_route(robot, probe, start, end, rng)
    return None if found is None else _shorten_route(robot, probe, found, rng)


@dataclass(frozen=True)
class _Tree:
    """Postures that can be reached from the first one, and whence each."""

    postures: list[Array]
    parents: list[int] = field(default_factory=lambda: [-1])

    def grow(self, robot: Robot, probe: CollisionProbe, target: Array, *, all_the_way: bool) -> bool:
        """Grow a branch towards a posture, or branches until there; True if it was reached."""
        while True:
            nearest = int(np.argmin([np.abs(posture - target).max() for posture in self.postures]))
            way = target - self.postures[nearest]
            share = min(1.0, _BRANCH / max(float(np.abs(way).max()), 1e-12))
            reached = self.postures[nearest] + share * way
            if not is_straight_free(robot, probe, self.postures[nearest], reached):
                return False
            self.postures.append(target if share == 1.0 else reached)
            self.parents.append(nearest)
            if share == 1.0 or not all_the_way:
                return share == 1.0

    def branch(self) -> list[Array]:
        """Postures from the first one to the newest."""
        at, found = len(self.postures) - 1, []
        while at >= 0:
            found.append(self.postures[at])
            at = self.parents[at]
        return found[::-1]


def _search_route(
    robot: Robot, probe: CollisionProbe, start: Array, end: Array, rng: np.random.Generator
) -> list[Array] | None:
    lower, upper = robot.limits.position_lower, robot.limits.position_upper
    first, second, turned = _Tree([start]), _Tree([end]), False
    while len(first.postures) + len(second.postures) < _BRANCHES:
        size = len(first.postures)
        first.grow(robot, probe, rng.uniform(lower, upper), all_the_way=False)
        if len(first.postures) > size and second.grow(robot, probe, first.postures[-1], all_the_way=True):
            there, back = (second, first) if turned else (first, second)
            return [*there.branch(), *back.branch()[::-1][1:]]
        first, second, turned = second, first, not turned
    return None


def _shorten_route(
    robot: Robot, probe: CollisionProbe, way: list[Array], rng: np.random.Generator
) -> list[Array]:
    """The way without postures that a straight line may leave out."""
    for _ in range(_SHORTCUTS):
        if len(way) == 2:
            break
        i, j = sorted(rng.choice(len(way), 2, replace=False).tolist())
        if j > i + 1 and is_straight_free(robot, probe, way[i], way[j]):
            way = way[: i + 1] + way[j:]
    return way
