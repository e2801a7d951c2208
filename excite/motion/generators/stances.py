"""Motions of the trunk and feet of a standing robot: squats, sways, pelvis turns, foot swings."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pinocchio as pin

from excite.motion.generators.curves import SplineCurve
from excite.motion.generators.generator import (
    Candidate,
    Generator,
    Proposal,
    all_feet,
    alternating_joints,
    leg_joints,
    pelvis_height,
    support_centre,
    support_corners,
    support_reach,
)
from excite.motion.generators.joint_motions import posture_curve, posture_draws
from excite.motion.generators.leg_swing import Lift, lifting_candidate, swing_displacements
from excite.robot.robot import Foot, Robot
from excite.robot.shapes.shape import has_area

# The trunk moves and turns while all feet stay down: squats on two, sways on three or more.

# In shares of the trunk's height: how far it goes down and up. Roll, pitch and yaw [rad].
_DOWN, _UP, _TURN = (0.13, 0.25), (0.02, 0.08), ((0.20, 0.12, 0.35), (0.25, 0.2, 0.3))
# How far the centre of mass sways: in x and y, in shares of the leg's length; of a robot on more feet in shares of its
# way to the edge of the support polygon, and of the trunk's height, which is what the legs reach.
_SWAY, _SWAY_SHARE, _SWAY_REACH = (0.02, 0.08), 0.5, 0.2


class _OnAllFeet(Generator):
    """Motion of trunk and centre of mass over feet that stay down: every leg bends, turns and carries.

    Attributes:
        least: number of feet that it needs.
        waypoints: least number of control points, and the number that there are always fewer of.
    """

    least: ClassVar[int]
    waypoints: ClassVar[tuple[int, int]]

    def applies(self, robot: Robot) -> bool:
        """For a robot with enough feet that span an area."""
        return len(robot.feet) >= self.least and has_area(support_corners(robot, robot.feet))

    def aims(self, robot: Robot) -> tuple[str, ...]:
        """The joints of the legs."""
        return tuple(robot.joint_names[i] for foot in robot.feet for i in leg_joints(robot, foot))

    def draw(self, robot: Robot, seed: int, targets: tuple[str, ...], name: str) -> Candidate:
        """A spline of trunk and centre of mass through random control points."""
        rng = np.random.default_rng(seed)
        n, more = int(rng.integers(*self.waypoints)), int(self.least > 2)
        height = pelvis_height(robot)
        low = np.array([-_DOWN[more] * height, *(-turn for turn in _TURN[more])])
        high = np.array([_UP[more] * height, *_TURN[more]])
        pelvis, com = np.zeros((n + 6, 4)), np.zeros((n + 6, 2))
        pelvis[3:-3] = rng.uniform(low, high, size=(n, 4))
        if more:
            reach = min(_SWAY_SHARE * support_reach(robot, robot.feet), _SWAY_REACH * height)
            com[3:-3] = rng.uniform(-reach, reach, size=(n, 2))
        else:
            # Down and up in turn, so that the knees work.
            pelvis[3:-3:2, 0] = rng.uniform(low[0], 0.6 * low[0], size=len(pelvis[3:-3:2]))
            com[3:-3] = height * rng.uniform(-1.0, 1.0, size=(n, 2)) * _SWAY
        draws = posture_draws(robot, targets, rng.uniform(0.1, 0.45, size=robot.n_joints), 3, 3 + n)
        posture = posture_curve(robot, draws, n + 6, rng)
        return Candidate(
            name,
            self.name,
            targets,
            seed,
            posture,
            draws=draws,
            pelvis=SplineCurve(pelvis),
            com=SplineCurve(com),
            phases=all_feet(robot, posture.length),
        )


class Squat(_OnAllFeet):
    """Pelvis motion in double support: the legs carry, bend and turn, the arms swing along."""

    name: ClassVar[str] = "squat"
    summary: ClassVar[str] = "squats, sways and pelvis turns on both feet"
    needs: ClassVar[str] = "it needs at least two feet with an area between them"
    least, waypoints = 2, (8, 12)


class Sway(_OnAllFeet):
    """Translations and turns of the trunk on three feet or more: every leg bends, turns and carries in turn."""

    name: ClassVar[str] = "sway"
    summary: ClassVar[str] = "the trunk moves and turns on three feet or more, all of them down"
    needs: ClassVar[str] = "it needs at least three feet"
    least, waypoints = 3, (14, 24)


# A robot on three feet or more lifts one of them and swings it over the others' support polygon.

# How far the free leg's joints go from rest [rad], and the share of their range that they stay in.
_REACH, _RANGE = 0.9, 0.8


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
        data = robot.model.createData()
        centre = np.array(pin.centerOfMass(robot.model, data, robot.rest))[:2]
        shift = support_centre(robot, _other_feet(robot, swing), centre) - centre
        height, q = pelvis_height(robot), robot.rest.copy()
        q[:3] += np.append(shift, 0.0)
        n = int(rng.integers(12, 20))
        hip = robot.model.getJointId(robot.joint_names[leg_joints(robot, swing)[0]])
        places = robot.model.jointPlacements
        offsets = [places[joint].translation for joint in robot.model.supports[swing.joint] if joint > hip]
        length = float(sum(np.linalg.norm(offset) for offset in (*offsets, swing.placement.translation)))
        # The longest distance is a share of the leg's length when it is straight.
        lift = Lift(
            swing, q, height, clearance=0.08, lift=0.12, reach=_REACH, range=_RANGE, longest=0.95 * length
        )
        # Random motion of the trunk meanwhile: height [share of its own], roll, pitch, yaw [rad].
        return lifting_candidate(
            robot,
            Proposal(self.name, seed, targets, name),
            swing,
            swing_displacements(robot, lift, n, rng),
            rng,
            shift=shift,
            held=np.zeros(4),
            turns=np.array((0.04, 0.08, 0.08, 0.1)) * [height, 1.0, 1.0, 1.0],
        )


def _other_feet(robot: Robot, foot: Foot) -> list[Foot]:
    return [other for other in robot.feet if other.name != foot.name]
