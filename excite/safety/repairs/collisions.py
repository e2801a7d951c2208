"""A fast search for self-collisions along a path, used by repairs; the verdict has its own."""

from __future__ import annotations

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
