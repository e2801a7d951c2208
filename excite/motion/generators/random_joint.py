"""Random joint positions, one target joint at a time (Jovic et al. 2015, section II.B)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.motion.generators.bodyparts import central_range, rest_joints, upper_body
from excite.motion.generators.candidate import Candidate, Draws, SupportPhase
from excite.motion.generators.curves import SplineCurve
from excite.motion.generators.generator import Generator
from excite.robot.robot import Robot

# Control points: of the many light joints of a standing robot, of an arm that takes a second from one to the next.
_WAYPOINTS, _ARM_WAYPOINTS = (9, 14), (6, 10)
_OTHERS = (0.15, 0.7)


def posture_draws(robot: Robot, targets: tuple[str, ...], others: Array, first: int, stop: int) -> Draws:
    """The box for control points: 10–90 % of the range for targets, a part of it about rest for the others.

    Args:
        robot: the robot.
        targets: joints that move over 10–90 % of their range.
        others: share of that range which the other joints use, ``(n_joints,)``.
        first: index of the first control point that is drawn.
        stop: index after the last.
    """
    lower, upper = central_range(robot)
    rest = rest_joints(robot)
    share = np.where(np.isin(robot.joint_names, targets), 1.0, others)
    share[~upper_body(robot)] = 0.0
    # Rest may lie outside the central range (a joint resting near its stop): then the box reaches out to it.
    return Draws(
        lower=rest + share * (np.minimum(lower, rest) - rest),
        upper=rest + share * (np.maximum(upper, rest) - rest),
        first=first,
        stop=stop,
    )


def posture_curve(robot: Robot, draws: Draws, n_control: int, rng: np.random.Generator) -> SplineCurve:
    """A spline from rest to rest through drawn control points."""
    control = np.tile(rest_joints(robot), (n_control, 1))
    for i in range(draws.first, draws.stop):
        control[i] = draws.draw(rng)
    return SplineCurve(control)


class RandomJoint(Generator):
    """Random positions between 10 % and 90 % of the range, run as fast as the limits allow.

    For each degree of freedom in turn there are motions that throw it through its range while the other
    joints use a random part of theirs. Legs of a standing robot only balance.
    """

    name: ClassVar[str] = "random_joint"
    summary: ClassVar[str] = "random positions in 10–90 % of each joint's range, upper body or arm"
    needs: ClassVar[str] = "all its joints are in legs"

    def applies(self, robot: Robot) -> bool:
        """For a robot with joints that are in no leg."""
        return bool(upper_body(robot).any())

    def aims(self, robot: Robot) -> tuple[str, ...]:
        """Every joint that is in no leg."""
        return tuple(
            joint for joint, upper in zip(robot.joint_names, upper_body(robot), strict=True) if upper
        )

    def draw(self, robot: Robot, seed: int, targets: tuple[str, ...], name: str) -> Candidate:
        """A spline through random control points, from rest to rest."""
        rng = np.random.default_rng(seed)
        n = int(rng.integers(*(_WAYPOINTS if robot.feet else _ARM_WAYPOINTS)))
        others = rng.uniform(*_OTHERS, size=robot.n_joints)
        draws = posture_draws(robot, targets, others, 3, 3 + n)
        posture = posture_curve(robot, draws, n + 6, rng)
        feet = tuple(foot.name for foot in robot.feet)
        phases = (SupportPhase(0.0, posture.length, feet),) if feet else ()
        return Candidate(name, self.name, targets, seed, posture, draws=draws, phases=phases)
