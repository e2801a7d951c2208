"""A way for the joints round the robot's own bodies: RRT-Connect (Kuffner and LaValle 2000) and shortcuts."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from excite.arrays import Array
from excite.robot.robot import Robot
from excite.safety.repairs.collisions import CollisionProbe

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
