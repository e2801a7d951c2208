"""Walking out and back, over random footprints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin

from excite.arrays import Array, Moved
from excite.errors import NoSolutionError
from excite.motion.generators.curves import PolynomialCurve, hermite_curve, polyline_curve
from excite.motion.generators.generator import (
    Candidate,
    Generator,
    SupportPhase,
    leg_joints,
    pelvis_height,
    sole_half_width,
)
from excite.motion.generators.joint_motions import posture_curve, posture_draws
from excite.robot.joint_values import per_joint
from excite.robot.robot import Foot, Robot
from excite.robot.shapes.shape import joints_at

# Steps out; as many back.
_STEPS = (1, 4)
# Over how long the weight passes from foot to foot, in periods in which the robot rocks sideways on one leg; stances
# before and after, in such times; shortest single support [s].
_PERIODS, _ENDS, _SWING_S = (1.0, 1.25), 2, 0.75
# In shares of the pelvis's height: length and sideways part of what the robot is carried in a step.
_LENGTH, _SIDEWAYS = (0.03, 0.11), 0.025
# Between the soles' inner edges there is at least this [m]; they are at most this much farther apart [of that at rest].
_GAP, _WIDER = 0.1, 0.2
# What of the gap between them they may use up: a step sideways, a turn with a step, a swing's way aside and its yaw.
_USE = (0.2, 0.2, 0.1, 0.3)
# Half way of a swing: height [share of the pelvis's], way along and aside [m], roll, pitch and yaw of the sole [rad].
_LIFT, _ASIDE = (0.04, 0.1), (0.05, 0.01)
# Largest lift by the legs' acceleration limit [rad/s²], pelvis's height and single support's duration squared.
_LIFT_BY_ACCELERATION = 0.0075
_SOLE_TURN, _OUTER_EDGE_UP = (0.05, 0.25, 0.25), 0.07
# Pelvis: it goes down [share of its height], and from step to step it moves [share of its height], rolls, pitches and
# yaws [rad].
_DOWN, _PELVIS = 0.045, (0.012, 0.03, 0.07, 0.12)
# Towards the foot that stands the pelvis leans by [rad], which spares ankles and servos.
_LEAN = (0.1, 0.2)


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
        # About the duration of a span of the arms' spline [s].
        spans = max(6, round(duration / 0.6))
        # One unit of the path parameter is a span of the arms' spline.
        rate = spans / duration
        draws = posture_draws(robot, targets, rng.uniform(0.05, 0.4, size=robot.n_joints), 3, spans)
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
    # Turn with a step [rad].
    aside, turn = min(_SIDEWAYS * height, _USE[0] * gap), min(0.12, 2.0 * _USE[1] * gap / length)
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
    # How much of the lift a tilted sole's corner may take away.
    turn[:2] *= min(1.0, 0.6 * up / lowered)
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


# Where the feet of a walk are put down, and how they get there.


@dataclass(frozen=True, eq=False)
class Print:
    """A sole flat on the ground.

    Attributes:
        position: of its middle, ``(2,)`` [m].
        yaw: of its x axis [rad].
    """

    position: Array
    yaw: float


@dataclass(frozen=True, eq=False)
class Step:
    """One swing.

    Attributes:
        foot: index of the foot that swings.
        print: where it comes down.
    """

    foot: int
    print: Print


@dataclass(frozen=True, eq=False)
class Sole:
    """A foot's sole where the robot rests.

    Attributes:
        foot: the foot.
        print: where it stands.
        length: of the largest rectangle about the sole's middle that lies in it, along its x [m].
        width: along its y [m].
    """

    foot: Foot
    print: Print
    length: float
    width: float


@dataclass(frozen=True, eq=False)
class Swing:
    """When and how a foot moves to its next print.

    Attributes:
        start: path parameter at which it leaves the ground.
        end: path parameter at which it is down again.
        height: of the sole's middle half way [m].
        turn: rotation vector of the sole half way, beside its yaw, ``(3,)`` [rad].
        aside: half way, out of the straight line, ``(2,)`` [m].
    """

    start: float
    end: float
    height: float
    turn: Array
    aside: Array


def resting_soles(robot: Robot) -> tuple[Sole, ...]:
    """The soles as they stand at rest, in the order of ``robot.feet``."""
    data = joints_at(robot.model, robot.rest)
    soles = []
    for foot in robot.feet:
        frame = data.oMi[foot.joint] * foot.placement
        yaw = float(np.arctan2(frame.rotation[1, 0], frame.rotation[0, 0]))
        corners = np.array([frame.actInv(data.oMi[foot.joint].act(corner))[:2] for corner in foot.sole])
        length, width = 2.0 * np.minimum(corners.max(axis=0), -corners.min(axis=0))
        soles.append(Sole(foot, Print(frame.translation[:2].copy(), yaw), float(length), float(width)))
    return tuple(soles)


def there_and_back(soles: Sequence[Sole], first: int, ways: Array, width: float) -> tuple[Step, ...]:
    """Steps that carry the robot along and back again, both soles in the end where they rest.

    With each step one sole comes to where it would be if the robot, standing as at rest, had been carried to
    the step's place; at the far end and at home the other sole follows.

    Args:
        soles: the two soles at rest.
        first: index of the foot that steps first.
        ways: displacement of the robot with each step out, in its own frame: x, y [m] and yaw [rad], ``(k, 3)``;
            the way back is in ``k`` equal parts.
        width: distance of the soles from the middle between them while the robot walks, in that at rest.

    Returns:
        ``2 k + 2`` steps.
    """
    middle = np.mean([sole.print.position for sole in soles], axis=0)
    place, yaw, out = np.zeros(2), 0.0, []
    for x, y, turn in ways:
        place = place + _plane_rotation(yaw) @ np.array([x, y])
        yaw += float(turn)
        out.append((place, yaw))
    back = [(share * place, share * yaw) for share in np.linspace(1.0, 0.0, len(ways) + 1)[1:]]
    places = [*out, out[-1], *back, back[-1]]
    steps = []
    for k, (at, turned) in enumerate(places):
        sole = soles[(first + k) % 2].print
        apart = width if k < len(places) - 2 else 1.0
        position = middle + at + _plane_rotation(turned) @ (apart * (sole.position - middle))
        steps.append(Step((first + k) % 2, Print(position, sole.yaw + turned)))
    return tuple(steps)


def sole_curve(
    sole: Sole, prints: Sequence[Print], swings: Sequence[Swing], length: float
) -> PolynomialCurve:
    """Displacement of a sole from where it rests, ``(6,)``: translation [m], then rotation vector [rad].

    Args:
        sole: the sole.
        prints: where it is put down, one after the other.
        swings: the swing that leads to each, in order.
        length: of the path parameter's interval, at which the curve ends.
    """
    knots, values, first, second = [0.0], [np.zeros(6)], [np.zeros(6)], [np.zeros(6)]
    for target, swing in zip(prints, swings, strict=True):
        start, end = values[-1], np.zeros(6)
        end[:2] = target.position - sole.print.position
        end[5] = target.yaw - sole.print.yaw
        bump = np.r_[swing.aside, swing.height, swing.turn]
        duration = swing.end - swing.start
        knots += [swing.start, 0.5 * (swing.start + swing.end), swing.end]
        values += [start, 0.5 * (start + end) + bump, end]
        # The derivatives half way of a quintic blend, and of the bump 64 u³ (1 − u)³.
        first += [np.zeros(6), 1.875 * (end - start) / duration, np.zeros(6)]
        second += [np.zeros(6), -24.0 * bump / duration**2, np.zeros(6)]
    for column in (values, first, second):
        column.append(column[-1])
    return hermite_curve(np.r_[knots, length], np.array(values), np.array(first), np.array(second))


def _plane_rotation(angle: float) -> Array:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


# How slowly a robot rocks sideways on the springs that its servos are.


def rocking_period(robot: Robot) -> float:
    """Period of the sideways oscillation on one leg [s].

    The robot is a rigid inverted pendulum; the roll joints of the leg, as stiff as the position servo's gains, and the
    edges of the sole are springs in series: ``T = 2π √(I / (k − m g h))``.
    """
    model, data = robot.model, robot.model.createData()
    pin.crba(model, data, robot.rest)
    centre = np.array(pin.centerOfMass(model, data, robot.rest))
    height = float(centre[2])
    weight = robot.mass * float(np.linalg.norm(model.gravity.linear))
    pin.ccrba(model, data, robot.rest, np.zeros(model.nv))
    inertia = float(data.Ig.inertia[0, 0]) + robot.mass * height**2
    # Gain of a servo that nobody stated, in weights of the robot times the height of its centre of mass per radian: as
    # stiff as those of the bundled robots.
    usual = np.full(robot.n_joints, 25.0 * weight * height)
    gains = per_joint(robot.description.controller.kp, robot.joint_names, usual)
    pin.forwardKinematics(model, data, robot.rest)
    pin.computeJointJacobians(model, data, robot.rest)
    foot = robot.feet[0]
    # How far a sole sinks into the ground under the robot's weight [m], as hard rubber does: with this a narrow sole is
    # a softer spring than the leg above it.
    softness = float(1e-4 / (weight * sole_half_width(foot) ** 2))
    for index in leg_joints(robot, foot):
        joint = model.getJointId(robot.joint_names[index])
        axis = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)[3:, model.idx_vs[joint]]
        # An axis this near to the forward direction bends the leg sideways.
        if abs(axis[0]) > 0.7:
            softness += 1.0 / gains[index]
    stiffness = 1.0 / softness
    return float(2.0 * np.pi * np.sqrt(inertia / max(stiffness - weight * height, 0.5 * stiffness)))


# The centre of mass over given footprints, by placo's walk pattern generator.

# What placo's planner looks for in a robot; of its geometry it uses nothing.
_FRAMES = ("left_foot", "right_foot", "left_hip_yaw", "head_base", "head_pitch", "camera")


@dataclass(frozen=True)
class Timing:
    """How a walk goes on in time.

    Attributes:
        interval: over which the pattern's jerk is constant [s].
        step: intervals of a step; in the first the zero-moment point passes from sole to sole.
        ends: intervals of the stance on both feet before the first and after the last step.
    """

    interval: float
    step: int
    ends: int


@dataclass(frozen=True, eq=False)
class WalkPattern:
    """A planned walk.

    Attributes:
        time: knots, ``(m,)`` [s], from 0.
        com: horizontal position of the centre of mass at the knots, ``(m, 2)`` [m]; in between, acceleration
            changes linearly.
        velocity: ``(m, 2)`` [m/s].
        acceleration: ``(m, 2)`` [m/s²].
        swings: start and end of each step's single support, ``(n_steps, 2)`` [s].
    """

    time: Array
    com: Array
    velocity: Array
    acceleration: Array
    swings: Array


def plan_pattern(soles: Sequence[Sole], steps: Sequence[Step], timing: Timing, com: Array) -> WalkPattern:
    """Plan the centre of mass of a walk as a linear inverted pendulum.

    placo (Duclusaud et al. 2025; the pendulum after Kajita et al. 2003, jerk constant in each interval) keeps the
    zero-moment point in the soles that carry and as near to their middle as it can. It takes the first interval of a
    step to get there, so that the other foot is in the air only from the second on.

    Args:
        soles: the two soles at rest.
        steps: the steps.
        timing: of the steps.
        com: centre of mass at rest, ``(3,)`` [m].

    Returns:
        The pattern; it ends at rest, half way between the soles.

    Raises:
        NoSolutionError: no motion of the centre of mass keeps the zero-moment point in the soles.
    """
    import placo

    left = int(soles[1].print.position[1] > soles[0].print.position[1])
    sides = [placo.HumanoidRobot_Side.right, placo.HumanoidRobot_Side.right]
    sides[left] = placo.HumanoidRobot_Side.left
    parameters = _walk_parameters(soles, timing, float(com[2]))
    robot = placo.HumanoidRobot("", int(placo.Flags.ignore_collisions), _skeleton_urdf())
    footsteps = placo.Footsteps()
    last = steps[0].foot
    for foot, where in ((last, soles[last].print), (1 - last, soles[1 - last].print)):
        footsteps.append(_build_footstep(parameters, sides[foot], where))
    for step in steps:
        footsteps.append(_build_footstep(parameters, sides[step.foot], step.print))
    supports = placo.FootstepsPlanner.make_supports(footsteps, 0.0, True, False, True)
    try:
        plan = placo.WalkPatternGenerator(robot, parameters).plan(supports, com, 0.0)
    except RuntimeError as error:
        raise NoSolutionError(
            "no walk over these footprints", best=None, remedy="shorten the steps"
        ) from error
    return _read_plan(plan, timing)


def _read_plan(plan: Any, timing: Timing) -> WalkPattern:
    """The plan's knots and phases."""
    knots, swings, start = [0.0], [], 0.0
    while start < plan.t_end - 1e-9:
        middle = start + 1e-6
        end = plan.get_part_t_end(middle)
        n = max(1, round((end - start) / timing.interval))
        knots += list(start + (end - start) * np.arange(1, n + 1) / n)
        if not plan.support_is_both(middle):
            swings.append((knots[-n], end))
        start = end
    time = np.array(knots)
    com, velocity, acceleration = (
        np.array([read(t)[:2] for t in time])
        for read in (plan.get_p_world_CoM, plan.get_v_world_CoM, plan.get_a_world_CoM)
    )
    # Solved for to some 1e-9; the ends are at rest by definition.
    velocity[[0, -1]] = acceleration[[0, -1]] = 0.0
    return WalkPattern(time, com, velocity, acceleration, np.array(swings))


def _walk_parameters(soles: Sequence[Sole], timing: Timing, height: float) -> Any:
    import placo

    parameters = placo.HumanoidParameters()
    parameters.single_support_duration = timing.step * timing.interval
    parameters.single_support_timesteps = timing.step
    parameters.double_support_ratio = 0.0
    parameters.startend_double_support_ratio = timing.ends / timing.step
    parameters.walk_com_height = height
    parameters.foot_length = min(sole.length for sole in soles)
    parameters.foot_width = min(sole.width for sole in soles)
    narrow = 0.5 * min(parameters.foot_length, parameters.foot_width)
    # Distance of the zero-moment point from the edges of the rectangle in a sole: share of its half width, at most [m].
    parameters.zmp_margin = min(0.8 * narrow, 0.03)
    # Weight of its distance from where it should be, against the pattern's jerk.
    parameters.zmp_reference_weight = 10.0
    parameters.foot_zmp_target_x = 0.0
    # Its distance inwards from a sole's middle: share of what the half width has beyond [m]. The less the body sways
    # the less it rocks, and inwards it steps on its other foot; a narrow sole has nothing to spare.
    parameters.foot_zmp_target_y = -0.55 * max(0.0, 0.5 * parameters.foot_width - 0.025)
    return parameters


def _build_footstep(parameters: Any, side: Any, where: Print) -> Any:
    import placo

    footstep = placo.Footstep(parameters.foot_width, parameters.foot_length)
    frame = np.eye(4)
    frame[:2, :2] = _plane_rotation(where.yaw)
    frame[:2, 3] = where.position
    footstep.frame = frame
    footstep.side = side
    return footstep


def _skeleton_urdf() -> str:
    links = "".join(f'<link name="{name}"/>' for name in ("trunk", *_FRAMES))
    joints = "".join(
        f'<joint name="to_{name}" type="fixed"><parent link="trunk"/><child link="{name}"/></joint>'
        for name in _FRAMES
    )
    return f'<robot name="walker">{links}{joints}</robot>'
