"""Large, fast motion of one joint and its neighbours while the rest of the robot moves slowly."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.arrays import Array, Flags, Indices
from excite.motion.generators.generator import (
    Candidate,
    Draws,
    Generator,
    all_feet,
    leg_joints,
    stands_on_either,
    upper_body,
)
from excite.motion.generators.joint_motions import posture_curve, posture_draws
from excite.motion.generators.leg_swing import swinging_candidate
from excite.robot.robot import Robot

# Times that a target goes to one end of its range, and control points that it stays there: fewer and the spline would
# average the motion away.
_ENDS, _STAY = (5, 9), (1, 4)
# How far from an end of the range it may stay, in shares of the range.
_SHORT = 0.25
# In a leg: how far targets and others go, in shares of what they do in a leg swing.
_FAR, _LEG = 1.4, (0.5, 1.0)
# Shares of their range that its neighbours and the other joints use, and over how many control points these pass from
# one posture to the next.
_NEIGHBOURS, _OTHERS, _SLOWLY = (0.3, 1.0), (0.1, 0.6), 6


class Aimed(Generator):
    """Throws a joint from end to end of its range, for parameters that other motions leave uncertain.

    The bodies that it moves are its own and the next ones, so the joints before and after it move at random. The others
    change the posture so slowly that they do not limit the speed. A joint of a leg is aimed at on the other leg.
    """

    name: ClassVar[str] = "aimed"
    summary: ClassVar[str] = "one joint from end to end of its range, its neighbours along, the rest slowly"

    def applies(self, robot: Robot) -> bool:
        """For a robot with joints that it can aim at."""
        return bool(self.aims(robot))

    def aims(self, robot: Robot) -> tuple[str, ...]:
        """Every joint; those of legs only of a robot that can stand on its other one of two."""
        possible = upper_body(robot) | stands_on_either(robot)
        return tuple(
            name for name, is_possible in zip(robot.joint_names, possible, strict=True) if is_possible
        )

    def draw(self, robot: Robot, seed: int, targets: tuple[str, ...], name: str) -> Candidate:
        """A spline from rest to rest through random targets; for legs a stance on the other one."""
        rng = np.random.default_rng(seed)
        shares, fast = _joint_shares(robot, targets, rng)
        legs = {i for foot in robot.feet for i in leg_joints(robot, foot)}
        if robot.joint_index(targets[0]) in legs:
            reach = rng.uniform(*_LEG, size=robot.n_joints)
            reach[np.isin(robot.joint_names, targets)] = _FAR
            return swinging_candidate(robot, seed, targets, name, self.name, reach)
        stays = rng.integers(*_STAY, size=int(rng.integers(*_ENDS)))
        draws = posture_draws(robot, targets, shares, 3, 3 + int(stays.sum()))
        curve = posture_curve(robot, draws, draws.stop + 3, rng)
        postures = curve.control[draws.first : draws.stop]
        postures[:, ~fast] = _slow_ways(postures[:, ~fast])
        for target in targets:
            column = robot.joint_index(target)
            curve.control[draws.first : draws.stop, column] = _from_end_to_end(draws, column, stays, rng)
        phases = all_feet(robot, curve.length)
        return Candidate(name, self.name, targets, seed, curve, draws=draws, phases=phases)


def _from_end_to_end(draws: Draws, column: int, stays: Indices, rng: np.random.Generator) -> Array:
    """Control points of a target: near one end of its box, then near the other, and so on."""
    lower, upper = draws.lower[column], draws.upper[column]
    side = (np.arange(len(stays)) + rng.integers(2)) % 2
    short = _SHORT * rng.uniform(size=len(stays))
    share = np.repeat(np.where(side == 0, short, 1.0 - short), stays)
    return np.asarray(lower + share * (upper - lower))


def _slow_ways(points: Array) -> Array:
    """Straight ways through every few of the points, ``(n, k)``."""
    kept = np.unique(np.r_[0 : len(points) : _SLOWLY, len(points) - 1])
    rows = np.arange(len(points))
    slow = np.empty_like(points)
    for k, column in enumerate(points.T):
        slow[:, k] = np.interp(rows, kept, column[kept])
    return slow


def _joint_shares(robot: Robot, targets: tuple[str, ...], rng: np.random.Generator) -> tuple[Array, Flags]:
    """Share of its range that each joint uses, and whether it is a target or next to one."""
    shares = rng.uniform(*_OTHERS, size=robot.n_joints)
    near = rng.uniform(*_NEIGHBOURS, size=robot.n_joints)
    fast = np.zeros(robot.n_joints, dtype=bool)
    first = robot.model.njoints - robot.n_joints
    for target in targets:
        own = robot.model.getJointId(target)
        for joint in range(first, robot.model.njoints):
            fast[joint - first] |= own == robot.model.parents[joint] or joint == robot.model.parents[own]
    shares[fast] = near[fast]
    aimed = [robot.joint_index(target) for target in targets]
    shares[aimed], fast[aimed] = 1.0, True
    return shares, fast
