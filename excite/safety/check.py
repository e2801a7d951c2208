"""The independent verdict: every check, on a finer grid than the one that the motion was planned on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

from excite.motion.motion import Motion
from excite.registry import add_installed
from excite.robot.prismatic import sliding_joints
from excite.robot.robot import Robot
from excite.robot.shapes.stand_ins import shape_conditions
from excite.safety.checks.base import Check, CheckResult
from excite.safety.checks.collision import judge_self_collision
from excite.safety.checks.ground import (
    judge_centre_of_mass,
    judge_contact_wrench,
    judge_feet,
    judge_zero_moment_point,
)
from excite.safety.checks.joints import (
    judge_jerks,
    judge_mechanism,
    judge_positions,
    judge_rates,
    judge_rest,
    judge_torques,
)
from excite.safety.checks.motion import judge_identity, judge_sampling
from excite.safety.checks.robustness import judge_robustness
from excite.safety.checks.sweep import Sweep
from excite.safety.parameter_set import ParameterSet, stated_parameters
from excite.safety.verdict import Margins, Nearest, Verdict, Violation, unit_of


def check_motion(
    robot: Robot,
    motion: Motion,
    *,
    rate_hz: float | None = None,
    neighbours: Mapping[str, Motion] | None = None,
    parameters: ParameterSet | None = None,
    robust: bool = False,
) -> Verdict:
    """Judge a motion; nothing is repaired, and what cannot be computed makes the motion unsafe.

    Args:
        robot: the robot that shall run it.
        motion: the motion.
        rate_hz: rate of the grid that it is judged on [Hz], never below the motion's own; by default twice
            that, at least 200 Hz. Limits and self-collision hold between the grid's samples too.
        neighbours: motions that are judged together with it, by name: where it says that it goes on from one of
            them, or one from it, it need not start or end at rest.
        parameters: the robots over which margins are wanted too; None for no such margins.
        robust: whether the motion is safe only if it is so for all of these; for those that the robot's description
            states, where ``parameters`` are left out.

    Returns:
        The verdict. A motion of which nothing could be computed (NaN, unsorted time, wrong joints, missing
        contact flags) has the reason as its violations, and no margins.

    Raises:
        InputError: ``rate_hz`` is not positive.
        RobotError: the robot's collision geometry cannot be read.
    """
    sweep = Sweep(robot, motion, rate_hz, neighbours or {})
    violations: list[Violation] = []
    margins: dict[str, float] = {}
    not_applicable: list[str] = []
    nearest: dict[str, tuple[Nearest, ...]] = {}
    readable = True
    for check in CHECKS.values():
        result = check().judge(sweep)
        violations += result.violations
        if check.margin_field is not None and not result.applicable:
            not_applicable.append(check.margin_field)
        elif check.margin_field is not None and result.margin is not None:
            margins[check.margin_field] = result.margin
            if result.nearest:
                nearest[check.margin_field] = result.nearest
        readable = result.readable
        if not readable:
            break
    if parameters is None and robust:
        parameters = stated_parameters(robot)
    found = (
        judge_robustness(sweep, parameters, decides=robust) if readable and parameters is not None else None
    )
    if found is not None and robust:
        violations += found.violations()
    sliding = sliding_joints(robot)
    violations = [replace(one, unit=unit_of(one.kind, one.where, sliding)) for one in violations]
    return Verdict(
        motion=motion.name,
        margins=Margins(**margins),
        violations=tuple(sorted(violations, key=lambda v: -float("inf") if v.time_s is None else v.time_s)),
        not_applicable=tuple(not_applicable),
        readable=readable,
        nearest=nearest,
        as_far_as=shape_conditions(robot) if readable else (),
        robust=found,
    )


def _make_check(name: str, judge: Callable[[Sweep], CheckResult], margin: str | None = None) -> type[Check]:
    members = {"name": name, "margin_field": margin, "judge": lambda _, sweep: judge(sweep)}
    return type(name, (Check,), members)


# The checks that make up a verdict, by name, in the order in which they run; those with a margin with its field.

CHECKS: dict[str, type[Check]] = {
    row[0]: _make_check(*row)
    for row in (
        ("sampling", judge_sampling),
        ("mechanism", judge_mechanism),
        ("identity", judge_identity),
        ("rest", judge_rest),
        ("joint_position", judge_positions, "joint_position_rad"),
        ("joint_velocity", partial(judge_rates, "velocity"), "joint_velocity_rad_s"),
        ("joint_acceleration", partial(judge_rates, "acceleration"), "joint_acceleration_rad_s2"),
        ("joint_jerk", judge_jerks, "joint_jerk_rad_s3"),
        ("foot", judge_feet),
        ("zmp", judge_zero_moment_point, "zmp_m"),
        ("com", judge_centre_of_mass),
        ("contact_wrench", judge_contact_wrench),
        ("joint_torque", judge_torques, "joint_torque_nm"),
        ("self_collision", judge_self_collision, "self_collision_m"),
    )
}
add_installed("checks", CHECKS)
