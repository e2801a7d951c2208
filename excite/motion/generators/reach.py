"""A hand at random places of the space that it must not leave (inverse kinematics)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.motion.generators.generator import (
    Candidate,
    Draws,
    Generator,
    all_feet,
    free_upper_body,
)
from excite.motion.generators.joint_motions import posture_curve, posture_draws
from excite.robot.robot import Robot

# Control points, and the share of their range that postures are begun from.
_PLACES, _RANGE = (6, 14), (0.4, 1.0)
# Places are drawn so often until one is within reach; steps of Newton's method to each, damped by so much [m].
_TRIES, _STEPS, _DAMPING = 8, 25, 0.05
# Nearer than this a hand is there [m].
_THERE = 5e-3


@dataclass(frozen=True, eq=False)
class HandDraws(Draws):
    """Postures in which a hand is somewhere in a box; the other joints are drawn as they come.

    Attributes:
        robot: the robot.
        hand: model joint that carries the hand.
        cell: lowest and highest corner of the box, ``(2, 3)`` [m].
    """

    robot: Robot
    hand: int
    cell: Array

    def draw(self, rng: np.random.Generator) -> Array:
        """One posture: the place has the same law as joints have, the turn of the hand comes as it may."""
        for _ in range(_TRIES):
            share = 0.5 - 0.5 * np.cos(np.pi * rng.uniform(size=3))
            place = self.cell[0] + share * (self.cell[1] - self.cell[0])
            posture, apart = self._reached(super().draw(rng), place)
            if apart < _THERE:
                break
        return posture

    def _reached(self, joints: Array, place: Array) -> tuple[Array, float]:
        """The posture near one, ``(n_joints,)``, in which the hand is at a place, and how far from it it stays [m].

        The hand's point is its centre of mass; steps are those of damped least squares (Wampler 1986).
        """
        robot, at = self.robot, self._moving
        model, data, q = robot.model, robot.model.createData(), robot.rest.copy()
        q[robot.n_base_q :] = joints
        point = model.inertias[self.hand].lever
        for _ in range(_STEPS):
            jacobian = pin.computeJointJacobians(model, data, q)
            jacobian = pin.getJointJacobian(model, data, self.hand, pin.LOCAL_WORLD_ALIGNED)
            pose = data.oMi[self.hand]
            off = place - pose.act(point)
            if np.linalg.norm(off) < _THERE:
                break
            rows = (jacobian[:3] - pin.skew(pose.rotation @ point) @ jacobian[3:])[:, robot.n_base_v + at]
            step = rows.T @ np.linalg.solve(rows @ rows.T + _DAMPING**2 * np.eye(3), off)
            q[robot.n_base_q + at] = np.clip(q[robot.n_base_q + at] + step, self.lower[at], self.upper[at])
        return q[robot.n_base_q :], float(np.linalg.norm(off))

    @property
    def _moving(self) -> NDArray[np.intp]:
        """Joints that carry the hand and no foot."""
        first = self.robot.model.njoints - self.robot.n_joints
        above = [int(j) - first for j in self.robot.model.supports[self.hand] if j >= first]
        return np.array([j for j in above if free_upper_body(self.robot)[j]])


class Reach(Generator):
    """Random places of a hand in the space that the description states, and whatever postures it reaches them in."""

    name: ClassVar[str] = "reach"
    summary: ClassVar[str] = "a hand at random places of the stated cell"
    needs: ClassVar[str] = "it needs collision.cell in its description, and joints that are in no leg"

    def applies(self, robot: Robot) -> bool:
        """For a robot with hands whose space is stated."""
        return robot.description.collision.cell is not None and bool(self.aims(robot))

    def aims(self, robot: Robot) -> tuple[str, ...]:
        """The last joint of every limb that is no leg."""
        free, first = free_upper_body(robot), robot.model.njoints - robot.n_joints
        ends = set(range(first, robot.model.njoints)) - set(robot.model.parents)
        return tuple(robot.joint_names[j - first] for j in sorted(ends) if free[j - first])

    def draw(self, robot: Robot, seed: int, targets: tuple[str, ...], name: str) -> Candidate:
        """A spline from rest to rest, the hand at a random place at each control point."""
        rng = np.random.default_rng(seed)
        n = int(rng.integers(*_PLACES))
        box = posture_draws(robot, targets, rng.uniform(*_RANGE, size=robot.n_joints), 3, 3 + n)
        # What is aimed at further up the limb is aimed at by its end.
        hand = int(list(robot.model.subtrees[robot.model.getJointId(targets[0])])[-1])
        cell = np.array(robot.description.collision.cell)
        draws = HandDraws(box.lower, box.upper, box.first, box.stop, robot, hand, cell)
        posture = posture_curve(robot, draws, n + 6, rng)
        phases = all_feet(robot, posture.length)
        return Candidate(name, self.name, targets, seed, posture, draws=draws, phases=phases)
