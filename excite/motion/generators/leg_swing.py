"""One-leg stance with random swings of the free leg."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.motion.generators.curves import SplineCurve
from excite.motion.generators.generator import (
    Candidate,
    Generator,
    Proposal,
    SupportPhase,
    alternating_joints,
    base_shift,
    central_range,
    leg_joints,
    pelvis_height,
    pelvis_joint,
    rest_joints,
    sole_half_width,
    stands_on_either,
)
from excite.motion.generators.joint_motions import posture_curve, posture_draws
from excite.robot.legs import Ankle, before_knee
from excite.robot.robot import Foot, Robot
from excite.robot.shapes.shape import joints_at

# Number of swings. Over a broad sole, of this half width [m] or more, they are quick, and more of them make up for the
# seconds in which the weight shifts.
_SWINGS, _QUICK_SWINGS, _BROAD = (5, 8), (16, 20), 0.05
# How far the free leg's joints go from rest [rad], and the share of their range that they stay in.
_REACH, _RANGE = 0.55, 0.4
# The pelvis leans over the stance foot [rad], which spares the ankle, and goes down [share of its height, at least],
# which spares the other knee.
_LEAN, _DOWN = 0.24, 0.03
# How far inside the stance sole's middle the centre of mass stays, in shares of the sole's half width, where the ankle
# holds the robot there. The trunk leans outwards over the stance foot, so mass that the model does not know pulls
# outwards, where nothing catches the robot; inwards it steps on its other foot. A third leaves a G1 upright with 15 %
# of its mass added 10 cm above the trunk's centre and 5 cm to either side. Of eight swings each of a G1, an XBot-L and
# a TienKung with that mass on the back 5 or more stand; of the latter two none does with a quarter.
_BIAS = 0.34
# Rate of the path while the weight shifts [1/s]: it takes three units of it, and a robot that is heavier than its model
# must not swing over the foot's outer edge. With 15 % more weight 9 of 10 swings of a G1, 6 of 6 of an HRP-2 and 3 of 4
# of a Talos stand, with 1.4 as many and 2 of Talos, with 2.8 as many and 1 of Talos.
_SHIFT_RATE = 2.0
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
    data = joints_at(robot.model, robot.rest)
    lift = Lift(
        swing,
        _leaning_base(robot, ground, down),
        ground.height,
        clearance=0.06,
        lift=0.11,
        reach=_REACH,
        range=_RANGE,
        longest=float(_STRETCH * np.linalg.norm(ground.sole - data.oMi[hip].translation)),
        aside=(-0.02, 0.28, ground.outward),
    )
    displacements = swing_displacements(robot, lift, n, rng, shares)
    share = 1.0 if shares is None else float(shares[list(leg_joints(robot, swing))].mean())
    # Random pelvis motion: height [share of its own], roll, pitch, yaw [rad].
    return lifting_candidate(
        robot,
        Proposal(generator, seed, targets, name),
        swing,
        displacements,
        rng,
        shift=ground.shift,
        held=np.array([-down, ground.outward * _LEAN, 0.0, 0.0]),
        turns=np.array((0.02, 0.04, 0.08, 0.20)) * [ground.height, 1.0, 1.0, 1.0],
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
    eased = Ankle(robot, stance.joint, stance.sole.mean(axis=0)).ease_point(data.oMi, over, load)
    return _Ground(
        shift=over + eased - centre[:2],
        half_width=half_width,
        outward=outward,
        height=pelvis_height(robot),
        sole=sole,
    )


def _leaning_base(robot: Robot, ground: _Ground, down: float) -> Array:
    """About where the base is over the stance foot, its pelvis lower by ``down`` [m], all joints at rest ``(nq,)``."""
    data, q = joints_at(robot.model, robot.rest), robot.rest.copy()
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


# A foot that is lifted, swung at random over the others' support polygon, and put back where it was.

# Heights of the free sole before and after the swings, in shares of the lift: a robot that leans by a few
# millimetres touches down early, and then the foot has to be slow already.
_UP, _SETTLE = (0.06, 1.0), (1.0, 0.3, 0.1, 0.035)


@dataclass(frozen=True, eq=False)
class Lift:
    """How a foot is lifted and swung.

    Attributes:
        swing: the foot.
        q: configuration with the weight over the other feet and all joints at rest, ``(nq,)``.
        height: of the pelvis or trunk [m], whose shares the next two are.
        clearance: lowest corner of the free sole in a swing.
        lift: at the start and the end.
        reach: how far the leg's joints go from rest [rad].
        range: share of their range that they stay in.
        longest: distance from hip to sole [m].
        aside: how far outwards the sole goes, least and most, in shares of the height; and the sign of y outwards.
    """

    swing: Foot
    q: Array
    height: float
    clearance: float
    lift: float
    reach: float
    range: float
    longest: float
    aside: tuple[float, float, float] = (-np.inf, np.inf, 1.0)


def swing_displacements(
    robot: Robot, lift: Lift, n: int, rng: np.random.Generator, shares: Array | None = None
) -> Array:
    """Displacements of the free sole, ``(up to n + 6, 6)``: first and last straight above where it stood.

    The others are where random joint positions of the free leg would bring it with the weight over the other feet, so
    that the leg can follow; draws too low, too far aside or out of the leg's reach are thrown away.

    Args:
        robot: the robot.
        lift: of the foot.
        n: how many swings.
        rng: of the draws.
        shares: of their usual motion that the joints of the free leg make, ``(n_joints,)``; all of it if None.
    """
    swing, height, data = lift.swing, lift.height, robot.model.createData()
    up, settle = np.zeros((len(_UP), 6)), np.zeros((len(_SETTLE), 6))
    up[:, 2], settle[:, 2] = np.array(_UP) * lift.lift * height, np.array(_SETTLE) * lift.lift * height
    lower, upper = central_range(robot, lift.range)
    leg = np.array(leg_joints(robot, swing))
    rest = rest_joints(robot)[leg]
    lower = np.minimum(np.maximum(lower[leg], rest - lift.reach), rest)
    upper = np.maximum(np.minimum(upper[leg], rest + lift.reach), rest)
    if shares is not None:
        lower, upper = rest + shares[leg] * (lower - rest), rest + shares[leg] * (upper - rest)
    pin.forwardKinematics(robot.model, data, robot.rest)
    ground = np.array(data.oMi[swing.joint].act(swing.placement.translation))
    turned = np.array(data.oMi[swing.joint].rotation)
    hip = robot.model.getJointId(robot.joint_names[leg[0]])
    q, (inwards, outwards, sign) = lift.q.copy(), lift.aside
    space = np.array(robot.description.collision.cell or ([-np.inf] * 3, [np.inf] * 3))
    points: list[Array] = []
    for _ in range(2000):
        if len(points) == n:
            break
        q[robot.n_base_q + leg] = rng.uniform(lower, upper)
        pin.forwardKinematics(robot.model, data, q)
        pose = data.oMi[swing.joint]
        low = (swing.sole @ pose.rotation[2]).min() + pose.translation[2]
        sole = np.array(pose.act(swing.placement.translation))
        moved = sole - ground
        out = sign * moved[1] / height
        near = np.linalg.norm(sole - data.oMi[hip].translation) <= lift.longest
        is_inside = ((sole >= space[0]) & (sole <= space[1])).all()
        if near and is_inside and low > lift.clearance * height and inwards < out < outwards:
            points.append(np.r_[moved, pin.log3(pose.rotation @ turned.T)])
    return np.vstack([up, *points, settle])


def lifting_candidate(
    robot: Robot,
    own: Proposal,
    swing: Foot,
    displacements: Array,
    rng: np.random.Generator,
    *,
    shift: Array,
    held: Array,
    turns: Array,
    share: float = 1.0,
) -> Candidate:
    """A motion that shifts the weight over all feet but one, swings that one, and puts it back.

    Args:
        robot: the robot.
        own: name, generator, targets and seed.
        swing: the foot that is free.
        displacements: of its sole, from :func:`swing_displacements`.
        rng: of the draws of pelvis and arms.
        shift: of the centre of mass, ``(2,)`` [m].
        held: offset of the pelvis meanwhile: height [m], roll, pitch and yaw [rad].
        turns: how far it moves at random beside that.
        share: of these.
    """
    lift, land = 6, 6 + len(displacements)
    free, m = slice(lift + len(_UP), land - len(_SETTLE)), land + 6
    com, foot, pelvis = np.zeros((m, 2)), np.zeros((m, 6)), np.zeros((m, 4))
    com[3 : land + 3], foot[lift:land], pelvis[3 : land + 3] = shift, displacements, held
    pelvis[free] += rng.uniform(-1.0, 1.0, size=(free.stop - free.start, 4)) * turns * share
    draws = posture_draws(robot, own.targets, rng.uniform(0.03, 0.2, size=robot.n_joints), 4, m - 4)
    every = tuple(each.name for each in robot.feet)
    carrying = tuple(name for name in every if name != swing.name)
    # The span that starts at parameter i is the first that control point i + 3 acts on.
    start, end = float(lift - 3), float(land)
    return Candidate(
        own.name,
        own.generator,
        own.targets,
        own.seed,
        posture_curve(robot, draws, m, rng),
        draws=draws,
        pelvis=SplineCurve(pelvis),
        com=SplineCurve(com),
        feet={swing.name: SplineCurve(foot)},
        phases=(
            SupportPhase(0.0, start, every, _SHIFT_RATE),
            SupportPhase(start, end, carrying),
            SupportPhase(end, float(m - 3), every, _SHIFT_RATE),
        ),
    )
