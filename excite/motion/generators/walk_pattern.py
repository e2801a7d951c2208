"""The centre of mass over given footprints, by placo's walk pattern generator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.errors import NoSolutionError
from excite.motion.generators.footprints import Print, Sole, Step

# What placo's planner looks for in a robot; of its geometry it uses nothing.
_FRAMES = ("left_foot", "right_foot", "left_hip_yaw", "head_base", "head_pitch", "camera")
# Distance of the zero-moment point from the edges of the rectangle in a sole: share of its half width, at most [m].
_MARGIN_SHARE, _MARGIN = 0.8, 0.03
# Weight of its distance from where it should be, against the pattern's jerk.
_WEIGHT = 10.0
# Its distance inwards from a sole's middle: share of what the half width has beyond [m]. The less the body sways the
# less it rocks, and inwards it steps on its other foot; a narrow sole has nothing to spare.
_INWARDS, _NARROW = 0.55, 0.025


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
    parameters.zmp_margin = min(_MARGIN_SHARE * narrow, _MARGIN)
    parameters.zmp_reference_weight = _WEIGHT
    parameters.foot_zmp_target_x = 0.0
    parameters.foot_zmp_target_y = -_INWARDS * max(0.0, 0.5 * parameters.foot_width - _NARROW)
    return parameters


def _build_footstep(parameters: Any, side: Any, where: Print) -> Any:
    import placo

    footstep = placo.Footstep(parameters.foot_width, parameters.foot_length)
    frame = np.eye(4)
    cos, sin = np.cos(where.yaw), np.sin(where.yaw)
    frame[:2, :2] = [[cos, -sin], [sin, cos]]
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
