"""A foot that is lifted, swung at random over the others' support polygon, and put back where it was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.motion.generators.curves import SplineCurve
from excite.motion.generators.generator import (
    Candidate,
    Proposal,
    SupportPhase,
    central_range,
    leg_joints,
    rest_joints,
)
from excite.motion.generators.joint_motions import posture_curve, posture_draws
from excite.robot.robot import Foot, Robot

# Heights of the free sole before and after the swings, in shares of the lift: a robot that leans by a few
# millimetres touches down early, and then the foot has to be slow already.
_UP, _SETTLE = (0.06, 1.0), (1.0, 0.3, 0.1, 0.035)
_ARMS = (0.03, 0.2)
_DRAWS = 2000


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
    points: list[Array] = []
    for _ in range(_DRAWS):
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
        if near and low > lift.clearance * height and inwards < out < outwards:
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
    rate: float,
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
        rate: of the path while the weight shifts [1/s]: the shift takes three units of it.
        held: offset of the pelvis meanwhile: height [m], roll, pitch and yaw [rad].
        turns: how far it moves at random beside that.
        share: of these.
    """
    lift, land = 6, 6 + len(displacements)
    free, m = slice(lift + len(_UP), land - len(_SETTLE)), land + 6
    com, foot, pelvis = np.zeros((m, 2)), np.zeros((m, 6)), np.zeros((m, 4))
    com[3 : land + 3], foot[lift:land], pelvis[3 : land + 3] = shift, displacements, held
    pelvis[free] += rng.uniform(-1.0, 1.0, size=(free.stop - free.start, 4)) * turns * share
    draws = posture_draws(robot, own.targets, rng.uniform(*_ARMS, size=robot.n_joints), 4, m - 4)
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
            SupportPhase(0.0, start, every, rate),
            SupportPhase(start, end, carrying),
            SupportPhase(end, float(m - 3), every, rate),
        ),
    )
