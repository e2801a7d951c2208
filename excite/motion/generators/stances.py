"""Motions of the trunk and feet of a standing robot: squats, sways, pelvis turns, foot swings."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.motion.generators.curves import SplineCurve
from excite.motion.generators.generator import (
    Candidate,
    Generator,
    SupportPhase,
    alternating_joints,
    central_range,
    leg_joints,
    pelvis_height,
    rest_joints,
    support_centre,
    support_corners,
    support_reach,
)
from excite.motion.generators.joint_motions import posture_curve, posture_draws
from excite.robot.robot import Foot, Robot
from excite.robot.shapes.shape import has_area

# Squats, sways and pelvis turns on both feet.

_WAYPOINTS = (8, 12)
# Shares of the leg's length: how far the pelvis goes down and up, how far the centre of mass sways in x and y.
_DOWN, _UP, _SWAY = 0.13, 0.02, (0.02, 0.08)
_TURN = (0.20, 0.12, 0.35)
_ARMS = (0.1, 0.45)


class Squat(Generator):
    """Pelvis motion in double support: the legs carry, bend and turn, the arms swing along."""

    name: ClassVar[str] = "squat"
    summary: ClassVar[str] = "squats, sways and pelvis turns on both feet"
    needs: ClassVar[str] = "it needs at least two feet with an area between them"

    def applies(self, robot: Robot) -> bool:
        """For a robot with at least two feet that span an area."""
        return len(robot.feet) >= 2 and has_area(support_corners(robot, robot.feet))

    def aims(self, robot: Robot) -> tuple[str, ...]:
        """The joints of the legs."""
        return tuple(robot.joint_names[i] for foot in robot.feet for i in leg_joints(robot, foot))

    def draw(self, robot: Robot, seed: int, targets: tuple[str, ...], name: str) -> Candidate:
        """A spline of pelvis and centre of mass through 8 to 11 random control points."""
        rng = np.random.default_rng(seed)
        n = int(rng.integers(*_WAYPOINTS))
        leg = pelvis_height(robot)
        low = np.array([-_DOWN * leg, *(-turn for turn in _TURN)])
        high = np.array([_UP * leg, *_TURN])
        pelvis, com = np.zeros((n + 6, 4)), np.zeros((n + 6, 2))
        pelvis[3:-3] = rng.uniform(low, high, size=(n, 4))
        # Down and up in turn, so that the knees work.
        pelvis[3:-3:2, 0] = rng.uniform(low[0], 0.6 * low[0], size=len(pelvis[3:-3:2]))
        com[3:-3] = leg * rng.uniform(-1.0, 1.0, size=(n, 2)) * _SWAY
        draws = posture_draws(robot, targets, rng.uniform(*_ARMS, size=robot.n_joints), 3, 3 + n)
        posture = posture_curve(robot, draws, n + 6, rng)
        feet = tuple(foot.name for foot in robot.feet)
        return Candidate(
            name,
            self.name,
            targets,
            seed,
            posture,
            draws=draws,
            pelvis=SplineCurve(pelvis),
            com=SplineCurve(com),
            phases=(SupportPhase(0.0, posture.length, feet),),
        )


# A robot on three feet or more lifts one of them and swings it over the others' support polygon.

_SWINGS = (12, 20)
# How far the free leg's joints go from rest [rad], and the share of their range that they stay in.
_REACH, _RANGE = 0.9, 0.8
# In shares of the trunk's height: lowest corner of the free foot, its lift before and after the swings.
_CLEARANCE, _LIFT = 0.08, 0.12
# Heights of the free foot at the start and the end, in shares of the lift: it touches down slowly.
_FOOT_SWING_UP, _SETTLE = (0.06, 1.0), (1.0, 0.3, 0.1, 0.035)
# Random motion of the trunk meanwhile: height [share of its own], roll, pitch, yaw [rad].
_TRUNK = (0.04, 0.08, 0.08, 0.1)
# Rate of the path while the weight shifts [1/s]: the shift takes three units of it.
_SHIFT_RATE = 2.0
# Longest distance from hip to foot, in shares of the leg's length when it is straight.
_STRETCH = 0.95
_FOOT_SWING_ARMS = (0.03, 0.2)
_DRAWS = 2000


class FootSwing(Generator):
    """Shift the weight over all feet but one, lift that one, swing it at random, put it back where it was."""

    name: ClassVar[str] = "foot_swing"
    summary: ClassVar[str] = "one foot of three or more is lifted and swung, the others carry"
    needs: ClassVar[str] = "it needs three feet or more, and an area between those that stay down"

    def applies(self, robot: Robot) -> bool:
        """For a robot that can stand on all feet but one."""
        return bool(self._free_feet(robot))

    def _free_feet(self, robot: Robot) -> list[Foot]:
        if len(robot.feet) < 3:
            return []
        return [f for f in robot.feet if has_area(support_corners(robot, _other_feet(robot, f)))]

    def aims(self, robot: Robot) -> tuple[str, ...]:
        """The joints of legs that may be lifted, one of each leg in turn."""
        return alternating_joints(robot, self._free_feet(robot))

    def draw(self, robot: Robot, seed: int, targets: tuple[str, ...], name: str) -> Candidate:
        """A candidate whose free leg is the one that holds the first target."""
        rng = np.random.default_rng(seed)
        free = self._free_feet(robot)
        target = robot.joint_index(targets[0])
        swing = next((foot for foot in free if target in leg_joints(robot, foot)), free[0])
        stance = _other_feet(robot, swing)
        data = robot.model.createData()
        centre = np.array(pin.centerOfMass(robot.model, data, robot.rest))[:2]
        shift = support_centre(robot, stance, centre) - centre
        height = pelvis_height(robot)
        points = _swing_displacements(robot, swing, np.append(shift, 0.0), int(rng.integers(*_SWINGS)), rng)
        lift, land = 6, 6 + len(points)
        m = land + 6
        com, foot, trunk = np.zeros((m, 2)), np.zeros((m, 6)), np.zeros((m, 4))
        com[3 : land + 3] = shift
        foot[lift:land] = points
        moving = slice(lift + len(_FOOT_SWING_UP), land - len(_SETTLE))
        turns = np.array(_TRUNK) * [height, 1.0, 1.0, 1.0]
        trunk[moving] = rng.uniform(-1.0, 1.0, size=(moving.stop - moving.start, 4)) * turns
        draws = posture_draws(robot, targets, rng.uniform(*_FOOT_SWING_ARMS, size=robot.n_joints), 4, m - 4)
        every, carrying = tuple(f.name for f in robot.feet), tuple(f.name for f in stance)
        # The span that starts at parameter i is the first that control point i + 3 acts on.
        start, end = float(lift - 3), float(land)
        return Candidate(
            name,
            self.name,
            targets,
            seed,
            posture_curve(robot, draws, m, rng),
            draws=draws,
            pelvis=SplineCurve(trunk),
            com=SplineCurve(com),
            feet={swing.name: SplineCurve(foot)},
            phases=(
                SupportPhase(0.0, start, every, _SHIFT_RATE),
                SupportPhase(start, end, carrying),
                SupportPhase(end, float(m - 3), every, _SHIFT_RATE),
            ),
        )


def _other_feet(robot: Robot, foot: Foot) -> list[Foot]:
    return [other for other in robot.feet if other.name != foot.name]


def _swing_displacements(robot: Robot, swing: Foot, shift: Array, n: int, rng: np.random.Generator) -> Array:
    """Displacements of the free foot, ``(up to n + 6, 6)``: first and last straight above where it stood.

    The others are where random joint positions of the leg bring it with the trunk shifted; draws too low or out of
    the leg's reach are thrown away.
    """
    data, height = robot.model.createData(), pelvis_height(robot)
    up, settle = np.zeros((len(_FOOT_SWING_UP), 6)), np.zeros((len(_SETTLE), 6))
    up[:, 2], settle[:, 2] = np.array(_FOOT_SWING_UP) * _LIFT * height, np.array(_SETTLE) * _LIFT * height
    lower, upper = central_range(robot, _RANGE)
    leg = np.array(leg_joints(robot, swing))
    rest = rest_joints(robot)[leg]
    lower, upper = np.maximum(lower[leg], rest - _REACH), np.minimum(upper[leg], rest + _REACH)
    lower, upper = np.minimum(lower, rest), np.maximum(upper, rest)
    pin.forwardKinematics(robot.model, data, robot.rest)
    ground, turned = np.array(data.oMi[swing.joint].act(swing.placement.translation)), data.oMi[swing.joint]
    sole_turn = np.array(turned.rotation)
    hip = robot.model.getJointId(robot.joint_names[leg[0]])
    offsets = [
        robot.model.jointPlacements[joint].translation for joint in _joints_beyond_hip(robot, hip, swing)
    ]
    length = float(sum(np.linalg.norm(offset) for offset in (*offsets, swing.placement.translation)))
    q = robot.rest.copy()
    q[:3] += shift
    points = np.zeros((n, 6))
    found = 0
    for _ in range(_DRAWS):
        if found == n:
            break
        q[robot.n_base_q + leg] = rng.uniform(lower, upper)
        pin.forwardKinematics(robot.model, data, q)
        pose = data.oMi[swing.joint]
        low = (swing.sole @ pose.rotation[2]).min() + pose.translation[2]
        sole = np.array(pose.act(swing.placement.translation))
        near = np.linalg.norm(sole - data.oMi[hip].translation) <= _STRETCH * length
        if near and low > _CLEARANCE * height:
            points[found] = np.r_[sole - ground, pin.log3(pose.rotation @ sole_turn.T)]
            found += 1
    return np.vstack([up, points[:found], settle])


def _joints_beyond_hip(robot: Robot, hip: int, foot: Foot) -> list[int]:
    """Joints of a leg after its first."""
    return [int(joint) for joint in robot.model.supports[foot.joint] if joint > hip]


# The trunk of a robot on three feet or more moves and turns while all of them stay down.

_SWAY_WAYPOINTS = (14, 24)
# Shares of the trunk's height at rest: how far it goes down and up.
_SWAY_DOWN, _SWAY_UP = 0.25, 0.08
# Roll, pitch, yaw [rad].
_SWAY_TURN = (0.25, 0.2, 0.3)
# How far the centre of mass goes, in shares of its way to the edge of the support polygon, and of the trunk's height,
# which is what the legs reach.
_SWAY_SWAY, _SWAY_REACH = 0.5, 0.2
_SWAY_ARMS = (0.1, 0.45)


class Sway(Generator):
    """Translations and turns of the trunk on three feet or more: every leg bends, turns and carries in turn."""

    name: ClassVar[str] = "sway"
    summary: ClassVar[str] = "the trunk moves and turns on three feet or more, all of them down"
    needs: ClassVar[str] = "it needs at least three feet"

    def applies(self, robot: Robot) -> bool:
        """For a robot with at least three feet that span an area."""
        return len(robot.feet) >= 3 and has_area(support_corners(robot, robot.feet))

    def aims(self, robot: Robot) -> tuple[str, ...]:
        """The joints of the legs."""
        return tuple(robot.joint_names[i] for foot in robot.feet for i in leg_joints(robot, foot))

    def draw(self, robot: Robot, seed: int, targets: tuple[str, ...], name: str) -> Candidate:
        """A spline of trunk and centre of mass through 14 to 23 random control points."""
        rng = np.random.default_rng(seed)
        n = int(rng.integers(*_SWAY_WAYPOINTS))
        height = pelvis_height(robot)
        low, high = (
            np.array([-_SWAY_DOWN * height, *(-t for t in _SWAY_TURN)]),
            np.array([_SWAY_UP * height, *_SWAY_TURN]),
        )
        reach = min(_SWAY_SWAY * support_reach(robot, robot.feet), _SWAY_REACH * height)
        pelvis, com = np.zeros((n + 6, 4)), np.zeros((n + 6, 2))
        pelvis[3:-3] = rng.uniform(low, high, size=(n, 4))
        com[3:-3] = rng.uniform(-reach, reach, size=(n, 2))
        draws = posture_draws(robot, targets, rng.uniform(*_SWAY_ARMS, size=robot.n_joints), 3, 3 + n)
        posture = posture_curve(robot, draws, n + 6, rng)
        feet = tuple(foot.name for foot in robot.feet)
        return Candidate(
            name,
            self.name,
            targets,
            seed,
            posture,
            draws=draws,
            pelvis=SplineCurve(pelvis),
            com=SplineCurve(com),
            phases=(SupportPhase(0.0, posture.length, feet),),
        )
