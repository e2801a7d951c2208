"""Coordinates in which motions are designed: joints, or the base and joints of a robot whose feet go as before.

With legs of six joints the poses of foot and base decide a leg's posture, and ``J dq = −J_b db`` where the foot stays.
Rates of what is no spline are those of a quintic spline through its samples, which is linear in these, so that
gradients need no more of the constraint than its Jacobian.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from excite.arrays import Array, Moved
from excite.motion.generators.generator import leg_joints
from excite.motion.motion import Motion
from excite.regressor.kernels import Placements, forward_kinematics
from excite.regressor.tree import PRISMATIC, KinematicTree, read_tree
from excite.robot.robot import Robot

# What counts as much of a base's position, velocity, acceleration and jerk as limits do of a joint's [m or rad, s]:
# what the ground bears is found in the search.
_BASE_LIMITS = np.array([[0.1], [0.3], [1.0], [np.inf]])
# Newton's steps for legs, the largest of them, and the one after which nothing is left to gain [rad].
_STEPS, _LARGEST, _ARRIVED = 12, 0.3, 1e-10


@dataclass(frozen=True, eq=False)
class JointCoordinates:
    """Joints that are moved on their own.

    Attributes:
        robot: the robot.
        own: joints that are coordinates, indices into ``joint_names``.
        motion: what is added to.
    """

    robot: Robot
    own: NDArray[np.intp]
    motion: Motion

    @property
    def limits(self) -> Array:
        """Of position from its middle, velocity, acceleration and jerk, ``(4, k)``; joints' are the last ones."""
        limits = self.robot.limits
        half = 0.5 * (limits.position_upper - limits.position_lower)
        return np.array([half, limits.velocity, limits.acceleration, limits.jerk])[:, self.own]

    def states(self, added: Sequence[Array]) -> Moved:
        """q, v and a for what is added to the coordinates and to their first and second derivatives, ``(n, k)``."""
        motion, robot = self.motion, self.robot
        found = Moved(*(np.array(values, order="C") for values in (motion.q, motion.v, motion.a)))
        firsts = (robot.n_base_q, robot.n_base_v, robot.n_base_v)
        for values, first, more in zip(found, firsts, added, strict=False):
            values[:, first + self.own] += more
        return found

    def pulled(self, state: Moved, pulls: Moved) -> tuple[Array, ...]:
        """Gradients in what is added, of those in q, v and a ``(n, nv)``, the base's position in the world's axes."""
        return tuple(pull[:, self.robot.n_base_v + self.own] for pull in pulls)


class FeetCoordinates(JointCoordinates):
    """Position of the base [m], its turn as twice Gibbs' vector, and joints in no leg; feet go as in the motion.

    Only what is added to values counts: rates follow from it.
    """

    @property
    def limits(self) -> Array:
        """See :class:`JointCoordinates`; the base's are what counts as much."""
        return np.hstack([np.repeat(_BASE_LIMITS, 6, axis=1), super().limits])

    @cached_property
    def _tree(self) -> KinematicTree:
        return read_tree(self.robot.model)

    @cached_property
    def _legs(self) -> list[NDArray[np.intp]]:
        """Model joints of each leg."""
        return [np.array(leg_joints(self.robot, foot)) + 2 for foot in self.robot.feet]

    @cached_property
    def _source(self) -> Moved:
        """Configurations, quaternions in one hemisphere, and their first and second derivatives, ``(n, nq)`` each."""
        q, v, a = np.array(self.motion.q), self.motion.v, self.motion.a
        q[:, 3:7] *= np.where(q[:, 6:7] < 0.0, -1.0, 1.0)
        turn, rotation = q[:, 3:7], _rotation(q[:, 3:7])
        spin = 0.5 * _times(turn, _pure(v[:, 3:6]))
        linear = a[:, :3] + np.cross(v[:, 3:6], v[:, :3])
        change = 0.5 * (_times(turn, _pure(a[:, 3:6])) + _times(spin, _pure(v[:, 3:6])))
        first = np.hstack([_applied(rotation, v[:, :3]), spin, v[:, 6:]])
        return Moved(q, first, np.hstack([_applied(rotation, linear), change, a[:, 6:]]))

    @cached_property
    def _feet(self) -> Placements:
        return forward_kinematics(self._tree, self._source[0])

    @cached_property
    def _rates(self) -> list[Array]:
        """First and second derivatives at the samples of what is added, by its values there, ``(n, n)`` each."""
        return _derivatives(self.motion.time, np.eye(self.motion.n_samples))

    def states(self, added: Sequence[Array]) -> Moved:
        """q, v and a for what is added to the coordinates, ``(n, k)``."""
        source, first, second = self._source
        q, more = source.copy(), added[0]
        q[:, :3] += more[:, :3]
        turn = _times(source[:, 3:7], np.hstack([0.5 * more[:, 3:6], np.ones((len(q), 1))]))
        q[:, 3:7] = turn / np.linalg.norm(turn, axis=1, keepdims=True)
        q[:, 7 + self.own] += more[:, 6:]
        self._place_legs(q)
        first, second = (
            known + new
            for known, new in zip((first, second), _derivatives(self.motion.time, q - source), strict=True)
        )
        turn, rotation = _conjugate(q[:, 3:7]), _rotation(q[:, 3:7]).transpose(0, 2, 1)
        v = np.hstack(
            [_applied(rotation, first[:, :3]), 2.0 * _times(turn, first[:, 3:7])[:, :3], first[:, 7:]]
        )
        linear = _applied(rotation, second[:, :3]) - np.cross(v[:, 3:6], v[:, :3])
        return Moved(q, v, np.hstack([linear, 2.0 * _times(turn, second[:, 3:7])[:, :3], second[:, 7:]]))

    def _place_legs(self, q: Array) -> None:
        """Newton's method on the poses of the feet."""
        for _ in range(_STEPS):
            poses, largest = forward_kinematics(self._tree, q), 0.0
            for leg in self._legs:
                foot = leg[-1]
                turned, wanted = poses.rotation[:, foot], self._feet.rotation[:, foot]
                miss = self._feet.translation[:, foot] - poses.translation[:, foot]
                twist = np.hstack([miss, 0.5 * np.cross(turned, wanted, axis=1).sum(axis=2)])
                step = np.linalg.solve(self._jacobian(poses, leg, foot), twist[:, :, None])[:, :, 0]
                step *= np.minimum(
                    1.0, _LARGEST / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-300)
                )
                q[:, 5 + leg] += step
                largest = max(largest, float(np.abs(step).max()))
            if largest < _ARRIVED:
                return

    def _jacobian(self, poses: Placements, joints: NDArray[np.intp], foot: int) -> Array:
        """Linear and angular velocity of a foot's frame by joints', world's axes, ``(n, 6, n_joints)``."""
        axis = np.einsum("njab,jb->nja", poses.rotation[:, joints], self._tree.axes[joints])
        arm = np.cross(axis, poses.translation[:, foot, None] - poses.translation[:, joints])
        slides = self._tree.kinds[joints] == PRISMATIC
        arm[:, slides], axis[:, slides] = axis[:, slides], 0.0
        return np.asarray(np.concatenate([arm, axis], axis=2).transpose(0, 2, 1))

    def pulled(self, state: Moved, pulls: Moved) -> tuple[Array, ...]:
        """Gradients in what is added to values, of those in q, v and a ``(n, nv)``."""
        (q, v, a), (by_q, by_v, by_a) = state, pulls
        turn, rotation = q[:, 3:7], _rotation(q[:, 3:7])
        spin, speed, thrust = v[:, 3:6], v[:, :3], a[:, :3] + np.cross(v[:, 3:6], v[:, :3])
        of_speed = by_v[:, :3] - np.cross(by_a[:, :3], spin)
        of_spin = by_v[:, 3:6] - np.cross(speed, by_a[:, :3])
        # By rates of positions and quaternions.
        first = np.hstack([_applied(rotation, of_speed), 2.0 * _times(turn, _pure(of_spin)), by_v[:, 6:]])
        second = np.hstack(
            [_applied(rotation, by_a[:, :3]), 2.0 * _times(turn, _pure(by_a[:, 3:6])), by_a[:, 6:]]
        )
        values = self._rates[0].T @ first + self._rates[1].T @ second
        # By the base's turn in its own axes: what it turns, with rates of positions and quaternions held.
        by_turn = by_q[:, 3:6] + 0.5 * _times(_conjugate(turn), values[:, 3:7])[:, :3]
        by_turn = by_turn - np.cross(speed, of_speed) - np.cross(thrust, by_a[:, :3])
        by_turn = by_turn - 0.5 * (np.cross(spin, of_spin) + np.cross(a[:, 3:6], by_a[:, 3:6]))
        slack = [(turn * rates).sum(axis=1, keepdims=True) for rates in self._quaternion_rates(q)]
        by_turn = by_turn - slack[0] * of_spin - slack[1] * by_a[:, 3:6]
        by_place, by_joint = by_q[:, :3] + values[:, :3], by_q[:, 6:] + values[:, 7:]
        poses = forward_kinematics(self._tree, q)
        for leg in self._legs:
            foot = leg[-1]
            jacobian = self._jacobian(poses, leg, foot).transpose(0, 2, 1)
            twist = np.linalg.solve(jacobian, by_joint[:, leg - 2][:, :, None])[:, :, 0]
            by_place = by_place - twist[:, :3]
            arm = poses.translation[:, foot] - q[:, :3]
            moment = np.cross(arm, twist[:, :3]) + twist[:, 3:]
            by_turn = by_turn - _applied(rotation.transpose(0, 2, 1), moment)
            between = np.setdiff1d(self.robot.model.supports[int(foot)], [0, 1, *leg])
            by_joint[:, between - 2] -= np.einsum("nij,ni->nj", self._jacobian(poses, between, foot), twist)
        half = 0.5 * self._turned(q)
        by_turn = (by_turn - np.cross(by_turn, half)) / (1.0 + (half**2).sum(axis=1, keepdims=True))
        return (np.hstack([by_place, by_turn, by_joint[:, self.own]]),)

    def _quaternion_rates(self, q: Array) -> list[Array]:
        source, first, second = self._source
        new = [rates @ (q - source)[:, 3:7] for rates in self._rates]
        return [first[:, 3:7] + new[0], second[:, 3:7] + new[1]]

    def _turned(self, q: Array) -> Array:
        """Twice Gibbs' vector of the base's turn against the source, ``(n, 3)``."""
        turn = _times(_conjugate(self._source[0][:, 3:7]), q[:, 3:7])
        return np.asarray(2.0 * turn[:, :3] / turn[:, 3:])


def can_hold_feet(robot: Robot) -> bool:
    """Whether a robot stands on soles by legs of six joints, whose postures follow from the poses of base and feet."""
    legs = [leg_joints(robot, foot) for foot in robot.feet]
    return bool(legs) and all(foot.flat for foot in robot.feet) and all(len(leg) == 6 for leg in legs)


def _derivatives(time: Array, values: Array) -> list[Array]:
    """First and second derivatives at the samples of the quintic spline through values, at rest at both ends."""
    rest = [(order, np.zeros(values.shape[1])) for order in (1, 2)]
    spline = make_interp_spline(time, values, k=5, bc_type=(rest, rest))
    return [np.asarray(spline.derivative(order)(time)) for order in (1, 2)]


# Quaternions x y z w, ``(n, 4)``.


def _times(one: Array, other: Array) -> Array:
    vector = np.cross(one[:, :3], other[:, :3]) + one[:, 3:] * other[:, :3] + other[:, 3:] * one[:, :3]
    scalar = one[:, 3:] * other[:, 3:] - (one[:, :3] * other[:, :3]).sum(axis=1, keepdims=True)
    return np.hstack([vector, scalar])


def _conjugate(turn: Array) -> Array:
    return np.asarray(turn * np.array([-1.0, -1.0, -1.0, 1.0]))


def _pure(vector: Array) -> Array:
    return np.hstack([vector, np.zeros((len(vector), 1))])


def _rotation(turn: Array) -> Array:
    """Matrices, ``(n, 3, 3)``."""
    return np.asarray(Rotation.from_quat(turn).as_matrix())


def _applied(rotation: Array, vector: Array) -> Array:
    return np.asarray(np.einsum("nij,nj->ni", rotation, vector))
