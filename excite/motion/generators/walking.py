"""Walking out and back, over random footprints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import pinocchio as pin

from excite.arrays import Array, Moved
from excite.motion.generators.bodyparts import leg_joints, pelvis_height
from excite.motion.generators.candidate import Candidate, SupportPhase
from excite.motion.generators.footprints import Sole, Step, Swing, resting_soles, sole_curve, there_and_back
from excite.motion.generators.generator import Generator
from excite.motion.generators.polynomials import PolynomialCurve, hermite_curve, polyline_curve
from excite.motion.generators.random_joint import posture_curve, posture_draws
from excite.motion.generators.rocking import rocking_period
from excite.motion.generators.walk_pattern import Timing, WalkPattern, plan_pattern
from excite.robot.robot import Robot

# Steps out; as many back.
_STEPS = (1, 4)
# Over how long the weight passes from foot to foot, in periods in which the robot rocks sideways on one leg; stances
# before and after, in such times; shortest single support [s].
_PERIODS, _ENDS, _SWING_S = (1.0, 1.25), 2, 0.75
# In shares of the pelvis's height: length and sideways part of what the robot is carried in a step.
_LENGTH, _SIDEWAYS = (0.03, 0.11), 0.025
# Turn with a step [rad].
_TURN = 0.12
# Between the soles' inner edges there is at least this [m]; they are at most this much farther apart [of that at rest].
_GAP, _WIDER = 0.1, 0.2
# What of the gap between them they may use up: a step sideways, a turn with a step, a swing's way aside and its yaw.
_USE = (0.2, 0.2, 0.1, 0.3)
# Half way of a swing: height [share of the pelvis's], way along and aside [m], roll, pitch and yaw of the sole [rad].
_LIFT, _ASIDE = (0.04, 0.1), (0.05, 0.01)
# Largest lift by the legs' acceleration limit [rad/s²], pelvis's height and single support's duration squared.
_LIFT_BY_ACCELERATION = 0.0075
_SOLE_TURN, _OUTER_EDGE_UP = (0.05, 0.25, 0.25), 0.07
# How much of the lift a tilted sole's corner may take away.
_TILT_SHARE = 0.6
# Pelvis: it goes down [share of its height], and from step to step it moves [share of its height], rolls, pitches and
# yaws [rad].
_DOWN, _PELVIS = 0.045, (0.012, 0.03, 0.07, 0.12)
# Towards the foot that stands the pelvis leans by [rad], which spares ankles and servos.
_LEAN = (0.1, 0.2)
_ARMS = (0.05, 0.4)
# About the duration of a span of the arms' spline [s].
_SPAN_S = 0.6


class Walking(Generator):
    """A dynamic walk, planned by placo's walk pattern generator; arms, pelvis and free foot move along at random."""

    name: ClassVar[str] = "walking"
    summary: ClassVar[str] = "walks out and back over random footprints (placo)"
    needs: ClassVar[str] = (
        "it needs two feet, each at the end of a leg of at least six joints, and sensors that walk along, "
        "not force plates"
    )

    def applies(self, robot: Robot) -> bool:
        """For a robot with exactly two feet, on legs that can put them anywhere, and not bound to force plates."""
        if len(robot.feet) != 2 or any(sensor.kind == "force_plate" for sensor in robot.sensors):
            return False
        return all(len(leg_joints(robot, foot)) >= 6 for foot in robot.feet)

    def aims(self, robot: Robot) -> tuple[str, ...]:
        """The joints of the legs; every walk moves all of them."""
        return tuple(robot.joint_names[i] for foot in robot.feet for i in leg_joints(robot, foot))

    def draw(self, robot: Robot, seed: int, targets: tuple[str, ...], name: str) -> Candidate:
        """A walk whose footprints, timing, swings, pelvis and arms are drawn; it runs at one speed only."""
        rng = np.random.default_rng(seed)
        height = pelvis_height(robot)
        soles = resting_soles(robot)
        width, gap = _walking_width(rng, soles)
        length = max(sole.length for sole in soles)
        steps = there_and_back(
            soles, int(rng.integers(2)), _step_displacements(rng, height, gap, length), width
        )
        interval = float(rng.uniform(*_PERIODS)) * rocking_period(robot)
        timing = Timing(interval, 1 + int(np.ceil(_SWING_S / interval)), _ENDS)
        com = np.array(pin.centerOfMass(robot.model, robot.model.createData(), robot.rest))
        pattern = plan_pattern(soles, steps, timing, com)
        duration = float(pattern.time[-1])
        spans = max(6, round(duration / _SPAN_S))
        # One unit of the path parameter is a span of the arms' spline.
        rate = spans / duration
        draws = posture_draws(robot, targets, rng.uniform(*_ARMS, size=robot.n_joints), 3, spans)
        offset, velocity, acceleration = _com_offset(pattern, com[:2])
        gravity = float(np.linalg.norm(robot.model.gravity.linear))
        lift = _lift_range(robot, self.aims(robot), (timing.step - 1) * timing.interval)
        feet = {}
        for index, sole in enumerate(soles):
            own = [k for k, each in enumerate(steps) if each.foot == index]
            swings = [_build_swing(rng, sole, rate * pattern.swings[k], lift, gap) for k in own]
            feet[sole.foot.name] = sole_curve(sole, [steps[k].print for k in own], swings, float(spans))
        return Candidate(
            name,
            self.name,
            targets,
            seed,
            posture_curve(robot, draws, spans + 3, rng),
            speed=rate,
            draws=draws,
            pelvis=_pelvis_curve(rng, soles, steps, rate * pattern.swings, float(spans), height),
            com=hermite_curve(rate * pattern.time, offset, velocity / rate, acceleration / rate**2),
            zmp=polyline_curve(rate * pattern.time, offset - acceleration * com[2] / gravity),
            feet=feet,
            phases=_support_phases(soles, steps, rate * pattern.swings, float(spans)),
        )


def _step_displacements(rng: np.random.Generator, height: float, gap: float, length: float) -> Array:
    """What the robot is carried with each step out: mostly forwards or backwards, ``(k, 3)``.

    Args:
        rng: of all draws.
        height: of the pelvis [m].
        gap: between the soles [m].
        length: of a sole [m]; its corners move sideways when it turns.
    """
    k = int(rng.integers(*_STEPS))
    ahead = rng.uniform(*_LENGTH, size=k) * rng.choice([-1.0, 1.0]) * height
    aside, turn = min(_SIDEWAYS * height, _USE[0] * gap), min(_TURN, 2.0 * _USE[1] * gap / length)
    return np.column_stack([ahead, rng.uniform(-aside, aside, size=k), rng.uniform(-turn, turn, size=k)])


def _walking_width(rng: np.random.Generator, soles: Sequence[Sole]) -> tuple[float, float]:
    """Distance of the soles while the robot walks, in that at rest, and the gap between them [m].

    They come near to each other, so that the robot need not sway far.
    """
    spacing = float(np.linalg.norm(soles[0].print.position - soles[1].print.position))
    wide = max(sole.width for sole in soles)
    least = min(1.0, (wide + _GAP) / spacing)
    width = float(rng.uniform(least, min(1.0, least + _WIDER)))
    return width, max(0.0, width * spacing - wide)


def _lift_range(robot: Robot, legs: Sequence[str], swing_s: float) -> tuple[float, float]:
    """Least and largest lift of a foot in a swing of so many seconds [m]."""
    height = pelvis_height(robot)
    slowest = float(robot.limits.acceleration[[robot.joint_index(joint) for joint in legs]].min())
    largest = min(_LIFT[1], _LIFT_BY_ACCELERATION * slowest * swing_s**2)
    return min(_LIFT[0], largest) * height, largest * height


def _build_swing(
    rng: np.random.Generator, sole: Sole, times: Array, lift: tuple[float, float], gap: float
) -> Swing:
    up = float(rng.uniform(*lift))
    turn = rng.uniform(-1.0, 1.0, size=3) * _SOLE_TURN
    # The free leg slants; a sole whose outer edge goes up spares its ankle.
    turn[0] += np.sign(sole.print.position[1]) * _OUTER_EDGE_UP
    lowered = 0.5 * (abs(turn[0]) * sole.width + abs(turn[1]) * sole.length)
    turn[:2] *= min(1.0, _TILT_SHARE * up / lowered)
    turn[2] *= min(1.0, 2.0 * _USE[3] * gap / (_SOLE_TURN[2] * sole.length))
    aside = rng.uniform(-1.0, 1.0, size=2) * [_ASIDE[0], min(_ASIDE[1], _USE[2] * gap)]
    return Swing(float(times[0]), float(times[1]), up, turn, aside)


def _com_offset(pattern: WalkPattern, rest: Array) -> Moved:
    """Offset of the centre of mass from where it rests, and its derivatives, at the pattern's knots.

    The pattern ends half way between the soles; during the last stance the centre of mass returns to where it rests.
    """
    com, velocity, acceleration = pattern.com - rest, pattern.velocity.copy(), pattern.acceleration.copy()
    start, end = pattern.swings[-1, 1], pattern.time[-1]
    last = pattern.time >= start
    u, stance = ((pattern.time[last] - start) / (end - start))[:, None], end - start
    left = com[-1].copy()
    com[last] -= u**3 * (10.0 - 15.0 * u + 6.0 * u**2) * left
    velocity[last] -= 30.0 * u**2 * (1.0 - u) ** 2 * left / stance
    acceleration[last] -= 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) * left / stance**2
    com[0] = 0.0
    return Moved(com, velocity, acceleration)


def _pelvis_curve(
    rng: np.random.Generator,
    soles: Sequence[Sole],
    steps: Sequence[Step],
    swings: Array,
    length: float,
    height: float,
) -> PolynomialCurve:
    """Height and turns of the pelvis: it faces where the feet do, and leans over the one that stands."""
    yaws = [sole.print.yaw for sole in soles]
    rest, down, lean = float(np.mean(yaws)), -_DOWN * height, float(rng.uniform(*_LEAN))
    aside = np.sign([soles[1 - i].print.position[1] - sole.print.position[1] for i, sole in enumerate(soles)])
    knots, values = [0.0], [np.zeros(4)]
    for step, times in zip(steps, swings, strict=True):
        for time in times:
            moved = rng.uniform(-1.0, 1.0, size=4) * _PELVIS * [height, 1.0, 1.0, 1.0]
            facing = np.array([down, -lean * aside[step.foot], 0.0, np.mean(yaws) - rest])
            knots.append(time)
            values.append(moved + facing)
            yaws[step.foot] = step.print.yaw
    return hermite_curve(np.array([*knots, length]), np.array([*values, np.zeros(4)]))


def _support_phases(
    soles: Sequence[Sole], steps: Sequence[Step], swings: Array, length: float
) -> tuple[SupportPhase, ...]:
    names = [sole.foot.name for sole in soles]
    phases, before = [], 0.0
    for step, (start, end) in zip(steps, swings, strict=True):
        phases.append(SupportPhase(before, float(start), tuple(names)))
        phases.append(SupportPhase(float(start), float(end), (names[1 - step.foot],)))
        before = float(end)
    return (*phases, SupportPhase(before, length, tuple(names)))
