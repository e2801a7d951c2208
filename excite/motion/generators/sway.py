"""The trunk of a robot on three feet or more moves and turns while all of them stay down."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.motion.generators.bodyparts import (
    leg_joints,
    pelvis_height,
    support_corners,
    support_reach,
)
from excite.motion.generators.candidate import Candidate, SupportPhase
from excite.motion.generators.curves import SplineCurve
from excite.motion.generators.generator import Generator
from excite.motion.generators.random_joint import posture_curve, posture_draws
from excite.robot.robot import Robot
from excite.robot.shapes.support_area import has_area

_WAYPOINTS = (14, 24)
# Shares of the trunk's height at rest: how far it goes down and up.
_DOWN, _UP = 0.25, 0.08
# Roll, pitch, yaw [rad].
_TURN = (0.25, 0.2, 0.3)
# How far the centre of mass goes, in shares of its way to the edge of the support polygon, and of the trunk's height,
# which is what the legs reach.
_SWAY, _REACH = 0.5, 0.2
_ARMS = (0.1, 0.45)


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
        n = int(rng.integers(*_WAYPOINTS))
        height = pelvis_height(robot)
        low, high = np.array([-_DOWN * height, *(-t for t in _TURN)]), np.array([_UP * height, *_TURN])
        reach = min(_SWAY * support_reach(robot, robot.feet), _REACH * height)
        pelvis, com = np.zeros((n + 6, 4)), np.zeros((n + 6, 2))
        pelvis[3:-3] = rng.uniform(low, high, size=(n, 4))
        com[3:-3] = rng.uniform(-reach, reach, size=(n, 2))
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
