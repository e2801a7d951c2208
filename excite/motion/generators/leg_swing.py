"""One-leg stance with random swings of the free leg."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.motion.generators.generator import (
    Candidate,
    Generator,
    Proposal,
    alternating_joints,
    base_shift,
    leg_joints,
    pelvis_height,
    pelvis_joint,
    sole_half_width,
    stands_on_either,
)
from excite.motion.generators.lifted_foot import Lift, lifting_candidate, swing_displacements
from excite.robot.legs import Ankle, before_knee
from excite.robot.robot import Foot, Robot

# Number of swings. Over a broad sole, of this half width [m] or more, they are quick, and more of them make up for the
# seconds in which the weight shifts.
_SWINGS, _QUICK_SWINGS, _BROAD = (5, 8), (16, 20), 0.05
# How far the free leg's joints go from rest [rad], and the share of their range that they stay in.
_REACH, _RANGE = 0.55, 0.4
# In shares of the pelvis's height: lowest corner of the free sole, farthest way in and out, lift at the start.
_CLEARANCE, _INWARDS, _OUTWARDS, _LIFT = 0.06, 0.02, 0.28, 0.11
# The pelvis leans over the stance foot [rad], which spares the ankle, and goes down [share of its height, at least],
# which spares the other knee.
_LEAN, _DOWN = 0.24, 0.03
# Random pelvis motion: height [share of its own], roll, pitch, yaw [rad].
_PELVIS = (0.02, 0.04, 0.08, 0.20)
# How far inside the stance sole's middle the centre of mass stays, in shares of the sole's half width, where the ankle
# holds the robot there. The trunk leans outwards over the stance foot, so mass that the model does not know pulls
# outwards, where nothing catches the robot; inwards it steps on its other foot. A third leaves a G1 upright with 15 %
# of its mass added 10 cm above the trunk's centre and 5 cm to either side. Of eight swings each of a G1, an XBot-L and
# a TienKung with that mass on the back 5 or more stand; of the latter two none does with a quarter.
_BIAS = 0.34
# Rate of the path while the weight shifts [1/s]: it takes three units of it, and a robot that is heavier than its model
# must not swing over the foot's outer edge.
_SHIFT_RATE = 1.4
# Longest distance from hip to a free sole, in shares of that at rest, and to an ankle that stays, of thigh and shank.
_STRETCH, _STRAIGHT = 0.98, 0.995


class LegSwing(Generator):
    """Shift the weight over one foot, lift the other, swing it at random, put it back where it was."""

    name: ClassVar[str] = "leg_swing"
    summary: ClassVar[str] = "one-leg stance, random swings of the free leg"
    needs: ClassVar[str] = "it needs exactly two feet, with soles"

    def applies(self, robot: Robot) -> bool:
        """For a robot with exactly two feet, on each of which it can stand."""
        return stands_on_either(robot)

    def aims(self, robot: Robot) -> tuple[str, ...]:
        """The joints of the legs, legs alternating."""
        return alternating_joints(robot, robot.feet)

    def draw(self, robot: Robot, seed: int, targets: tuple[str, ...], name: str) -> Candidate:
        """A candidate whose free leg is the one that holds the first target."""
        return swinging_candidate(robot, seed, targets, name, self.name)


def swinging_candidate(
    robot: Robot,
    seed: int,
    targets: tuple[str, ...],
    name: str,
    generator: str,
    shares: Array | None = None,
) -> Candidate:
    """A motion on one leg whose free leg is the one that holds the first target.

    Args:
        robot: a robot with two feet.
        seed: of all draws.
        targets: joints that it is aimed at.
        name: of the candidate.
        generator: registry name of the generator that proposes it.
        shares: of their usual motion that the joints of the free leg make, ``(n_joints,)``; the pelvis moves by their
            mean. By default all of it.
    """
    rng = np.random.default_rng(seed)
    swing, stance = robot.feet
    if robot.joint_index(targets[0]) in leg_joints(robot, stance):
        swing, stance = stance, swing
    ground = _stance_ground(robot, stance, swing)
    n = int(rng.integers(*(_QUICK_SWINGS if ground.half_width >= _BROAD else _SWINGS)))
    down = _pelvis_drop(robot, swing, ground)
    hip = robot.model.getJointId(robot.joint_names[leg_joints(robot, swing)[0]])
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.rest)
    lift = Lift(
        swing,
        _leaning_base(robot, ground, down),
        ground.height,
        _CLEARANCE,
        _LIFT,
        _REACH,
        _RANGE,
        float(_STRETCH * np.linalg.norm(ground.sole - data.oMi[hip].translation)),
        (-_INWARDS, _OUTWARDS, ground.outward),
    )
    displacements = swing_displacements(robot, lift, n, rng, shares)
    share = 1.0 if shares is None else float(shares[list(leg_joints(robot, swing))].mean())
    return lifting_candidate(
        robot,
        Proposal(generator, seed, targets, name),
        swing,
        displacements,
        rng,
        shift=ground.shift,
        rate=_SHIFT_RATE,
        held=np.array([-down, ground.outward * _LEAN, 0.0, 0.0]),
        turns=np.array(_PELVIS) * [ground.height, 1.0, 1.0, 1.0],
        share=share,
    )


@dataclass(frozen=True, eq=False)
class _Ground:
    """Where feet and centre of mass are at rest.

    Attributes:
        shift: from the centre of mass to where the stance foot holds it best, ``(2,)`` [m].
        half_width: of the stance sole [m].
        outward: sign of y from the stance foot to the free one.
        height: of the pelvis [m].
        sole: middle of the free sole, ``(3,)`` [m].
    """

    shift: Array
    half_width: float
    outward: float
    height: float
    sole: Array


def _stance_ground(robot: Robot, stance: Foot, swing: Foot) -> _Ground:
    data = robot.model.createData()
    centre = np.array(pin.centerOfMass(robot.model, data, robot.rest))
    corners = np.array([data.oMi[stance.joint].act(corner) for corner in stance.sole])
    middle = corners.mean(axis=0)
    pose = data.oMi[swing.joint]
    sole = np.array(pose.act(swing.placement.translation))
    half_width = sole_half_width(stance)
    outward = float(np.sign(sole[1] - middle[1]))
    over = middle[:2] + np.array([0.0, outward * _BIAS * half_width])
    load = robot.mass * float(np.linalg.norm(robot.model.gravity.linear))
    eased = Ankle(robot, stance.joint, stance.sole.mean(axis=0)).eased(data.oMi, over, load)
    return _Ground(
        shift=over + eased - centre[:2],
        half_width=half_width,
        outward=outward,
        height=pelvis_height(robot),
        sole=sole,
    )


def _leaning_base(robot: Robot, ground: _Ground, down: float) -> Array:
    """About where the base is over the stance foot, its pelvis lower by ``down`` [m], all joints at rest ``(nq,)``."""
    data, q = robot.model.createData(), robot.rest.copy()
    pin.forwardKinematics(robot.model, data, robot.rest)
    q[:3] += np.r_[base_shift(robot, ground.shift, ground.outward * _LEAN), -down]
    turn = pin.rpy.rpyToMatrix(ground.outward * _LEAN, 0.0, 0.0)
    above = robot.rest[:3] - data.oMi[pelvis_joint(robot)].translation
    q[:3] += turn @ above - above
    q[3:7] = (pin.Quaternion(turn) * pin.Quaternion(*q[[6, 3, 4, 5]])).coeffs()
    return np.asarray(q)


def _pelvis_drop(robot: Robot, swing: Foot, ground: _Ground) -> float:
    """How far the pelvis goes down while the weight shifts [m]: no less than the other leg needs to reach its foot."""
    data = robot.model.createData()
    joints = [robot.model.getJointId(robot.joint_names[i]) for i in leg_joints(robot, swing)]
    pin.forwardKinematics(robot.model, data, robot.rest)
    places = np.array([*(data.oMi[joint].translation for joint in joints), ground.sole])
    knee = before_knee(np.linalg.norm(np.diff(places, axis=0), axis=1)) + 1 if len(joints) > 1 else 0
    hip, ankle = places[0], places[-2]
    reach = _STRAIGHT * (np.linalg.norm(places[knee] - hip) + np.linalg.norm(ankle - places[knee]))
    pin.forwardKinematics(robot.model, data, _leaning_base(robot, ground, 0.0))
    x, y, z = data.oMi[joints[0]].translation - ankle
    return float(max(_DOWN * ground.height, z - np.sqrt(max(reach**2 - x**2 - y**2, 0.0))))
