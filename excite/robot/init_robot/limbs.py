"""Which limbs of a bare model are legs, where their feet touch the ground, and a footing that holds."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.optimize import least_squares
from scipy.spatial import ConvexHull, QhullError

from excite.arrays import Array
from excite.robot.legs import Ankle, before_knee
from excite.robot.links import link_placement
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_shapes, lowest_points, whole_centre
from excite.robot.shapes.shape import Shape, bottom_points, place_points

_LEG = re.compile(r"leg|foot|feet|ankle|toe|knee|hip|calf|thigh|shank|shin|sole|kfe|hfe", re.IGNORECASE)
_ARM = re.compile(r"arm|hand|wrist|elbow|shoulder|finger|gripper|claw", re.IGNORECASE)
# A ball of 30 mm radius has a patch of 27 mm within that of its lowest point; the narrowest sole known has 40 mm.
_POINT = 0.03


@dataclass(frozen=True, eq=False)
class FootGuess:
    """A foot: its link, corners in the link's frame ``(n, 3)`` [m], and the radius of a ball, zero of others [m]."""

    link: str
    sole: Array
    radius: float


class Figure:
    """A robot with its root at the world's origin, its shapes, and where they are in a posture.

    Attributes:
        robot: with a fixed base.
        points: points at joint 0 and every other one, in the joint's frame, of which one is the lowest.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot, self.model = robot, robot.model
        self.data = robot.model.createData()
        self.shapes = collision_shapes(robot)

    def lowest_heights(self, q: Array) -> dict[int, float]:
        """Height of the lowest point on each joint that has shapes, by joint [m]."""
        pin.forwardKinematics(self.model, self.data, q)
        return lowest_points(self.shapes, self.data)

    def is_guessed(self, joints: list[int]) -> bool:
        """Whether all shapes on one of some joints stand in for others: none says where a sole is."""
        return any(not self._known_shapes(joint) for joint in joints)

    def _known_shapes(self, joint: int) -> list[Shape]:
        """Shapes on a joint that stand in for no others."""
        stand_ins = self.robot.description.collision.stand_ins
        return [shape for shape in self.shapes if shape.joint == joint and shape.link not in stand_ins]

    def joint_chain(self, joint: int) -> list[int]:
        """Joints from the root to ``joint``."""
        return list(self.model.supports[joint])[1:]

    @cached_property
    def reach(self) -> float:
        """Length of the longest limb, from its first joint to its last [m]."""
        lengths = np.zeros(self.model.njoints)
        for joint, parent in enumerate(self.model.parents):
            if parent:
                step = np.linalg.norm(self.model.jointPlacements[joint].translation)
                lengths[joint] = lengths[parent] + step
        return float(lengths.max())

    @cached_property
    def beyond(self) -> Array:
        """Mass that each joint moves, ``(n_joints + 1,)`` [kg]."""
        masses = np.array([inertia.mass for inertia in self.model.inertias])
        for joint in range(self.model.njoints - 1, 0, -1):
            masses[self.model.parents[joint]] += masses[joint]
        return masses

    def mass_centre(self, q: Array) -> Array:
        """Centre of mass, the root's included ``(3,)`` [m]."""
        return whole_centre(self.model, self.data, q)

    def find_legs(self, q: Array, *, free: bool) -> list[int]:
        """Joints at the ends of the limbs that the robot stands on, empty if it stands on its base.

        Args:
            q: a posture ``(n_joints,)`` with the base upright.
            free: whether the model itself says that its base is free.
        """
        low = self.lowest_heights(q)
        ends = self._end_joints(low)
        if not ends:
            return []
        top = max(float(self.data.oMi[s.joint].act(s.placement.translation)[2]) for s in self.shapes)
        ground = min(low[j] for j in ends)
        # Feet of one stance differ in height by knees that cannot straighten; hands hang at 0.4 of a person's height.
        level = ground + 0.15 * max(top - ground, 1e-3)
        if low.get(0, np.inf) < level:
            return []
        kept: list[int] = []
        for end in sorted((j for j in ends if low[j] < level), key=lambda j: (round(low[j], 6), j)):
            if not any(self._same_foot(end, other) for other in kept):
                kept.append(end)
        named = sorted(j for j in kept if self._is_called(j, _LEG))
        if named or any(self._is_called(j, _ARM) for j in kept):
            return named
        return sorted(kept) if free or len(kept) >= 3 else []

    def has_folded_legs(self, q: Array) -> bool:
        """Whether the robot lies on its base with legs about it that are drawn flat: limbs from the root called so."""
        ends = self._end_joints(self.lowest_heights(q))
        legs = [j for j in ends if self._is_called(j, _LEG) and not self._is_called(j, _ARM)]
        return len({self.joint_chain(j)[0] for j in legs}) > 1

    def _end_joints(self, low: dict[int, float]) -> list[int]:
        """Joints at the ends of limbs of several joints that have shapes."""
        inner = set(self.model.parents)
        return [j for j in low if j and j not in inner and len(self.joint_chain(j)) >= 2]

    def _same_foot(self, one: int, other: int) -> bool:
        common = [a for a, b in zip(self.joint_chain(one), self.joint_chain(other), strict=False) if a == b]
        # Limbs that part beyond a joint which moves less than this share of the robot's mass end in one foot or hand.
        return bool(common) and self.beyond[common[-1]] < 0.12 * self.beyond[0]

    def _is_called(self, end: int, pattern: re.Pattern[str]) -> bool:
        names = [self.model.names[j] for j in self.joint_chain(end)]
        names += [shape.link for shape in self.shapes if shape.joint == end]
        return any(pattern.search(name) for name in names)

    def find_foot(self, joint: int, q: Array) -> FootGuess:
        """Where a leg's end touches the ground: a sole's corners, or a point or an edge where it is lowest at ``q``.

        A leg that can turn its end has the sole that is largest among the flat sides facing about downwards; a
        shorter leg touches where it happens to.
        """
        pin.forwardKinematics(self.model, self.data, q)
        pose = self.data.oMi[joint]
        own = self._known_shapes(joint)
        best, largest = self._find_touch(own, pose), -1.0
        # Height and tilt of a sole take three joints, and its place two more.
        if len(self.joint_chain(joint)) >= 5:
            for turn in _face_turns(np.vstack([bottom_points(shape, pose) for shape in own])):
                found = self._find_touch(own, turn * pose)
                area = turn.rotation[2, 2] * sole_area(found.sole)
                if area > largest + 1e-6:
                    best, largest = found, area
        return best

    def _find_touch(self, own: list[Shape], pose: pin.SE3) -> FootGuess:
        """Contact of shapes on one joint that is at ``pose``."""
        lows = [bottom_points(shape, pose) for shape in own]
        shape, floor = min(
            ((shape, float(points[:, 2].min())) for shape, points in zip(own, lows, strict=True)),
            key=lambda one: one[1],
        )
        # Hulls of meshes stand out by a hundredth of their size: what lies within this of the lowest point touches [m].
        corners = floor_outline(np.vstack([points[points[:, 2] < floor + 0.003] for points in lows]), floor)
        _, placement = link_placement(self.model, shape.link, self.robot.source, "feet")
        ball = shape.kind == "sphere" and len(corners) == 1
        if shape.kind == "cylinder" and len(corners) == 2 and shape.size[1] < 2.0 * shape.size[0]:
            # A wheel rolls as a ball does when its leg pitches. Tilted by 0.1 rad, one as wide as it is high would
            # touch lower by a twentieth of that.
            corners, ball = corners.mean(axis=0, keepdims=True), True
        sole = place_points(corners, (pose * placement).inverse())
        return FootGuess(shape.link, sole, shape.radius if ball else 0.0)


def _face_turns(points: Array) -> list[pin.SE3]:
    """Rotations that turn each side of the points' hull that faces about downwards to face down; first none."""
    down = np.array([0.0, 0.0, -1.0])
    turns = [pin.SE3.Identity()]
    try:
        normals = ConvexHull(points).equations[:, :3]
    except QhullError:
        return turns
    # Cosine of 45 degrees: soles face down so far in any posture in which a robot is drawn.
    for normal in normals[normals[:, 2] < -0.7]:
        rotation = pin.Quaternion.FromTwoVectors(normal, down).matrix()
        if all(np.linalg.norm(rotation - turn.rotation) > 0.01 for turn in turns):
            turns.append(pin.SE3(rotation, np.zeros(3)))
    return turns


def sole_area(corners: Array) -> float:
    """Area of a plane polygon ``(n, 3)`` [m²]; zero of points and edges."""
    if len(corners) < 3:
        return 0.0
    spokes = corners[1:] - corners[0]
    return float(0.5 * np.linalg.norm(np.cross(spokes[:-1], spokes[1:]).sum(axis=0)))


def floor_outline(points: Array, floor: float) -> Array:
    """Corners at height ``floor`` around points ``(n, 3)``: one, two, or at most eight anticlockwise [m]."""
    flat = points[:, :2]
    middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    _, _, axes = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=True)
    along = (flat - middle) @ axes.T
    width = np.ptp(along, axis=0)
    if width[0] < _POINT:
        return np.array([[*middle, floor]])
    if width[1] < 0.5 * _POINT:
        ends = middle + np.outer([along[:, 0].min(), along[:, 0].max()], axes[0])
        return np.column_stack([ends, np.full(2, floor)])
    try:
        hull = flat[ConvexHull(flat).vertices]
    except QhullError:
        return np.array([[*middle, floor]])
    corners = _reduce_polygon(hull, 8)
    return np.column_stack([corners, np.full(len(corners), floor)])


def _reduce_polygon(hull: Array, most: int) -> Array:
    """A polygon inside a convex one, with at most so many of its corners: those that cost least area go.

    Corners that cost next to none go as well: rounded, they would lie on one another.
    """
    while len(hull) > 3:
        before, after = np.roll(hull, 1, axis=0), np.roll(hull, -1, axis=0)
        one, two = hull - before, after - before
        area = 0.5 * np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
        # A square millimetre of a sole [m²].
        if len(hull) <= most and area.min() > 1e-6:
            break
        hull = np.delete(hull, int(np.argmin(area)), axis=0)
    return hull


# A figure's feet flat on one plane, its centre of mass where they hold it, found from a posture nearby.


@dataclass(frozen=True, eq=False)
class Standing:
    """A posture ``(n_joints,)`` on feet."""

    q: Array
    feet: tuple[FootGuess, ...]


class _Leg(NamedTuple):
    """A leg by the joint at its end, what it stands on, and what holds it over that."""

    end: int
    foot: FootGuess
    ankle: Ankle


class _Contacts(NamedTuple):
    """Heights of the soles' middles, their tilts, and the centre of mass from the feet's middle [m, rad].

    That is where soles and ankles hold the robot best.
    """

    heights: Array
    tilts: Array
    offset: Array


class Footing:
    """Postures of a figure on its feet, by least squares within limits.

    Args:
        figure: the robot with its root at the world's origin.
        lower, upper: where joints should stay ``(n_joints,)`` [rad or m]; they may go three fifths of the way from
            there to the robot's limits.
        drawn: the posture ``(n_joints,)`` that the model draws the robot in, whose soles face down [rad or m].
    """

    def __init__(self, figure: Figure, lower: Array, upper: Array, drawn: Array) -> None:
        self.figure, self.lower, self.upper, self.drawn = figure, lower, upper, drawn

    def find_stance(self, start: Array, legs: list[int]) -> Standing | None:
        """Inverse kinematics from ``start``; a foot that is no sole touches elsewhere when it turns, so thrice."""
        q, on = start, [self._leg_of(leg, self._find_foot(leg, start)) for leg in legs]
        limits, flat = self.figure.robot.limits, self.lower < self.upper
        low, high = (
            np.where(flat, 0.6 * end + 0.4 * inner, end)
            for end, inner in (
                (limits.position_lower + 1e-4, self.lower),
                (limits.position_upper - 1e-4, self.upper),
            )
        )
        if (high - low <= 1e-6).any():
            return None
        for _ in range(3):
            inside = np.clip(q, low + 1e-9, high - 1e-9)
            q = least_squares(
                self._posture_residual, inside, bounds=(low, high), args=(start, on), max_nfev=40
            ).x
            on = [
                leg if len(leg.foot.sole) >= 3 else self._leg_of(leg.end, self.figure.find_foot(leg.end, q))
                for leg in on
            ]
        heights, tilts, offset = self._contact_points(q, on)
        # Two millimetres and half a degree are below what soles and floors are flat to.
        level = np.ptp(heights) < 2e-3 and np.abs(tilts).max(initial=0.0) < 0.01
        feet = tuple(leg.foot for leg in on)
        return Standing(q, feet) if level and np.linalg.norm(offset) < 0.02 else None

    def _leg_of(self, end: int, foot: FootGuess) -> _Leg:
        middle = np.asarray(self._foot_placement(foot).act(foot.sole.mean(axis=0)))
        return _Leg(end, foot, Ankle(self.figure.robot, end, middle))

    def _find_foot(self, leg: int, start: Array) -> FootGuess:
        """The larger of the soles that face down at ``start`` and as drawn: a bent leg may point with its toes."""
        return max(
            (self.figure.find_foot(leg, q) for q in (start, self.drawn)),
            key=lambda foot: sole_area(foot.sole),
        )

    def sole_corners(self, stand: Standing, legs: list[int]) -> Array:
        """Corners of all soles seen from above, ``(n, 2)`` [m]."""
        self.figure.mass_centre(stand.q)
        pairs = zip(legs, stand.feet, strict=True)
        return np.vstack([self._sole_corners(leg, foot) for leg, foot in pairs])[:, :2]

    def _sole_corners(self, leg: int, foot: FootGuess) -> Array:
        """Corners of a sole where it is now, ``(n, 3)`` [m]."""
        return place_points(foot.sole, self.figure.data.oMi[leg] * self._foot_placement(foot))

    def knee_bend(self, stand: Standing, leg: int, foot: FootGuess) -> float:
        """Angle [rad] between thigh and shank, a leg's two longest parts in a row, seen along the joint between them; a
        stretched leg lifts no hip."""
        figure = self.figure
        figure.mass_centre(stand.q)
        pin.computeJointJacobians(figure.model, figure.data, stand.q)
        # From each joint of the leg to the next and from the last to the foot.
        ends = [figure.data.oMi[joint].translation for joint in figure.joint_chain(leg)]
        parts = np.diff([*ends, self._sole_corners(leg, foot).mean(axis=0)], axis=0)
        if len(parts) < 2:
            return np.inf
        k = before_knee(np.linalg.norm(parts, axis=1))
        knee = figure.joint_chain(leg)[k + 1]
        turn = pin.getJointJacobian(figure.model, figure.data, knee, pin.LOCAL_WORLD_ALIGNED)
        axis = turn[3:, knee - 1]
        # Thighs and shanks stand beside each other in some legs, however straight these are.
        parts = parts - (parts @ axis)[:, None] * axis
        sizes = np.linalg.norm(parts, axis=1)
        cosine = parts[k] @ parts[k + 1] / max(sizes[k] * sizes[k + 1], 1e-12)
        return float(np.arccos(np.clip(cosine, -1.0, 1.0)))

    def foot_agility(self, stand: Standing, leg: int, foot: FootGuess) -> float:
        """Least speed of a point foot at unit speed of its leg's joints, of its distance from the hip [1/rad].

        It is infinite of other feet, and of legs with fewer than three joints.
        """
        figure, chain = self.figure, self.figure.joint_chain(leg)
        if len(foot.sole) != 1 or len(chain) < 3:
            return np.inf
        figure.mass_centre(stand.q)
        pin.computeJointJacobians(figure.model, figure.data, stand.q)
        tip = self._sole_corners(leg, foot)[0]
        turn = pin.getJointJacobian(figure.model, figure.data, leg, pin.LOCAL_WORLD_ALIGNED)
        lever = tip - figure.data.oMi[leg].translation
        linear = turn[:3] - pin.skew(lever) @ turn[3:]
        slowest = np.linalg.svd(linear[:, [joint - 1 for joint in chain]])[1][-1]
        hip = figure.data.oMi[chain[0]].translation
        return float(slowest / max(np.linalg.norm(tip - hip), 1e-9))

    def _contact_points(self, q: Array, on: list[_Leg]) -> _Contacts:
        figure = self.figure
        centre = figure.mass_centre(q)
        load = figure.beyond[0] * float(np.linalg.norm(figure.model.gravity.linear)) / len(on)
        heights, tilts, middles = [], [], []
        for leg, foot, ankle in on:
            corners = self._sole_corners(leg, foot)
            middle = corners.mean(axis=0)
            middles.append(middle[:2])
            heights.append(corners[:, 2].mean())
            if len(corners) >= 3:
                normal = np.linalg.svd(corners - middle, full_matrices=False)[2][2]
                tilts += list(normal[:2] * np.sign(normal[2]))
                middles[-1] = middles[-1] + ankle.ease_point(figure.data.oMi, middle[:2], load)
            elif len(corners) == 2:
                tilts.append((corners[1] - corners[0])[2] / np.linalg.norm(corners[1] - corners[0]))
        return _Contacts(np.array(heights), np.array(tilts), centre[:2] - np.mean(middles, axis=0))

    def _foot_placement(self, foot: FootGuess) -> pin.SE3:
        model = self.figure.model
        return model.frames[model.getFrameId(foot.link, pin.BODY)].placement

    def _posture_residual(self, q: Array, start: Array, on: list[_Leg]) -> Array:
        heights, tilts, offset = self._contact_points(q, on)
        return np.concatenate(
            [10.0 * (heights - heights.mean()), 3.0 * tilts, 3.0 * offset, 0.02 * (q - start)]
        )
