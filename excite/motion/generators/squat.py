"""Squats, sways and pelvis turns on both feet."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.motion.generators.bodyparts import leg_joints, pelvis_height, support_corners
from excite.motion.generators.candidate import Candidate, SupportPhase
from excite.motion.generators.curves import SplineCurve
from excite.motion.generators.generator import Generator
from excite.motion.generators.random_joint import posture_curve, posture_draws
from excite.robot.robot import Robot
from excite.robot.shapes.support_area import has_area

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
