"""Which pairs of links a collision check may leave out, computed from the geometry."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.robot.robot import Robot
from excite.robot.shapes.collision import TABLE, collision_shapes, geometry_data, shape_pairs
from excite.robot.shapes.shape import coal_geometry

Array = NDArray[np.float64]

FAR = 0.02
"""Clearance beyond the margin that a pair must always keep to count as unable to meet [m]."""
NEAR_JOINTS = 3
"""Joints between two links up to which their relative posture is searched in full."""


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
    search = search or PairSearch(robot)
    margin = robot.description.collision.margin
    near = search.distances(robot.rest if rest is None else search.posture(rest))
    random = np.array([search.distances(q) for q in search.drawn(rng, n_random)]).reshape(
        n_random, len(search.pairs)
    )
    at_rest: list[tuple[str, str]] = []
    always: list[tuple[str, str]] = []
    never: list[tuple[str, str]] = []
    rest_collisions: list[tuple[str, str]] = []
    for column, pair in enumerate(search.pairs):
        between = search.joints_between(pair)
        neighbours = len(between) <= NEAR_JOINTS
        if np.mean(random[:, column] < margin) >= 0.99:
            always.append(pair)
        elif near[column] < margin:
            (at_rest if neighbours else rest_collisions).append(pair)
        elif neighbours and TABLE not in pair and random[:, column].min() > margin + FAR:
            # On the grid a mechanism is open.
            if robot.mechanism is None and search.grid_minimum(column, between) > margin + FAR:
                never.append(pair)
    return PairReview(tuple(at_rest), tuple(always), tuple(never), tuple(rest_collisions))


class PairSearch:
    """Distances between links, over all pairs that are not adjacent.

    Attributes:
        pairs: of links, in the order of the shapes.
    """

    def __init__(self, robot: Robot):
        shapes = collision_shapes(robot)
        self.robot = robot
        self.geometry = pin.GeometryModel()
        for shape in shapes:
            solid = pin.GeometryObject(shape.name, shape.joint, shape.placement, coal_geometry(shape))
            self.geometry.addGeometryObject(solid)
        index_pairs = shape_pairs(robot, shapes)
        for first, second in index_pairs:
            self.geometry.addCollisionPair(pin.CollisionPair(first, second))
        names = [(shapes[first].link, shapes[second].link) for first, second in index_pairs]
        self.pairs = list(dict.fromkeys(names))
        column = {pair: index for index, pair in enumerate(self.pairs)}
        self.columns = np.array([column[name] for name in names], dtype=np.int64)
        self.joints = {shape.link: shape.joint for shape in shapes}
        self.data, self.geometry_data = robot.model.createData(), geometry_data(self.geometry)

    def posture(self, joints: Array) -> Array:
        """A configuration ``(nq,)`` with the joints' positions given and the base at rest."""
        q = self.robot.rest.copy()
        q[self.robot.n_base_q :] = joints
        return q

    def drawn(self, rng: np.random.Generator, n: int) -> Array:
        """Random configurations within the limits, ``(n, nq)``; a mechanism is closed."""
        lower, upper = self.robot.limits.position_lower, self.robot.limits.position_upper
        if self.robot.mechanism is not None:
            return self.robot.mechanism.drawn(rng, lower, upper, n)
        return np.array([self.posture(rng.uniform(lower, upper)) for _ in range(n)])

    def distances(self, q: Array) -> Array:
        """Smallest distance of each pair of links [m], ``(n_pairs,)``."""
        pin.computeDistances(self.robot.model, self.data, self.geometry, self.geometry_data, q)
        found = np.full(len(self.pairs), np.inf)
        every = np.array([result.min_distance for result in self.geometry_data.distanceResults])
        np.minimum.at(found, self.columns, every)
        return found

    def joints_between(self, pair: tuple[str, str]) -> list[int]:
        """Model joints that change the pose of one link relative to the other."""
        parents = list(self.robot.model.parents)
        chains = []
        for link in pair:
            joint, chain = self.joints[link], set()
            while joint:
                chain.add(joint)
                joint = parents[joint]
            chains.append(chain)
        return sorted(chains[0] ^ chains[1])

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
                self.robot.model, self.data, self.geometry, self.geometry_data, self.posture(joints)
            )
            for index in wanted:
                result = pin.computeDistance(self.geometry, self.geometry_data, int(index))
                smallest = min(smallest, result.min_distance)
        return smallest
