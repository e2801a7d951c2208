"""One-leg stance with random swings of the free leg."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pinocchio as pin

from excite.motion.generators.bodyparts import leg_joints
from excite.motion.generators.candidate import Candidate, SupportPhase
from excite.motion.generators.curves import SplineCurve
from excite.motion.generators.generator import Generator
from excite.motion.generators.random_joint import posture_curve, posture_draws
from excite.robot.robot import Array, Foot, Robot

_SWINGS = (7, 11)
# In shares of the base's height: forward and back, outwards, up (from, to).
_FORWARD, _OUT, _UP = 0.28, (-0.03, 0.26), (0.14, 0.32)
_TURN = (0.35, 0.45, 0.5)
_PELVIS = (0.03, 0.12, 0.15, 0.20)
_ARMS = (0.05, 0.35)


class LegSwing(Generator):
    """Shift the weight over one foot, lift the other, swing it at random, put it back where it was."""

    name: ClassVar[str] = "leg_swing"
    summary: ClassVar[str] = "one-leg stance, random swings of the free leg"

    def applies(self, robot: Robot) -> bool:
        """For a robot with exactly two feet."""
        return len(robot.feet) == 2

    def aims(self, robot: Robot) -> tuple[str, ...]:
        """The joints of the legs, legs alternating."""
        left, right = (leg_joints(robot, foot) for foot in robot.feet)
        return tuple(robot.joint_names[i] for pair in zip(left, right, strict=True) for i in pair)

    def draw(self, robot: Robot, seed: int, targets: tuple[str, ...], name: str) -> Candidate:
        """A candidate whose free leg is the one that holds the first target."""
        rng = np.random.default_rng(seed)
        swing, stance = robot.feet
        if robot.joint_index(targets[0]) in leg_joints(robot, stance):
            swing, stance = stance, swing
        n = int(rng.integers(*_SWINGS))
        lift, land = 6, 6 + n + 2
        m = land + 6
        shift, outward = _ground_geometry(robot, stance, swing)
        com = np.zeros((m, 2))
        com[3 : land + 3] = shift
        foot = np.zeros((m, 6))
        foot[lift:land] = _swings(robot, n + 2, outward, rng)
        pelvis = np.zeros((m, 4))
        pelvis[lift + 1 : land - 1] = rng.uniform(-1.0, 1.0, size=(n, 4)) * _PELVIS
        draws = posture_draws(robot, targets, rng.uniform(*_ARMS, size=robot.n_joints), 4, m - 4)
        both, one = (robot.feet[0].name, robot.feet[1].name), (stance.name,)
        # The span that starts at parameter i is the first that control point i + 3 acts on.
        start, end = float(lift - 3), float(land)
        return Candidate(
            name,
            self.name,
            targets,
            seed,
            posture_curve(robot, draws, m, rng),
            draws=draws,
            pelvis=SplineCurve(pelvis),
            com=SplineCurve(com),
            feet={swing.name: SplineCurve(foot)},
            phases=(
                SupportPhase(0.0, start, both),
                SupportPhase(start, end, one),
                SupportPhase(end, float(m - 3), both),
            ),
        )


def _ground_geometry(robot: Robot, stance: Foot, swing: Foot) -> tuple[Array, float]:
    """Offset that brings the centre of mass over the stance foot, and the sign of y away from it."""
    data = robot.model.createData()
    centre = pin.centerOfMass(robot.model, data, robot.rest)
    over = data.oMi[stance.joint].act(stance.placement.translation)
    away = data.oMi[swing.joint].act(swing.placement.translation) - over
    return np.array(over[:2] - centre[:2]), float(np.sign(away[1]))


def _swings(robot: Robot, n: int, outward: float, rng: np.random.Generator) -> Array:
    """Displacements of the free sole, ``(n, 6)``: first and last straight above the place where it stood."""
    height = float(robot.rest[2])
    low = np.array([-_FORWARD, _OUT[0], _UP[0], *(-turn for turn in _TURN)])
    high = np.array([_FORWARD, _OUT[1], _UP[1], *_TURN])
    points = rng.uniform(low, high, size=(n, 6))
    points[:, :3] *= height
    points[:, 1] *= outward
    points[[0, -1]] = 0.0
    points[[0, -1], 2] = _UP[0] * height
    return points
