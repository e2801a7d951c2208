"""The independent verdict: every check, on a finer grid than the one that the motion was planned on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from excite.motion.motion import Motion
from excite.registry import add_installed
from excite.robot.prismatic import sliding_joints
from excite.robot.robot import Robot
from excite.robot.shapes.stand_ins import shape_conditions
from excite.safety.checks.base import Check
from excite.safety.checks.collision import SelfCollisionCheck
from excite.safety.checks.ground import CentreOfMassCheck, ContactWrenchCheck, FootCheck, ZeroMomentPointCheck
from excite.safety.checks.joints import (
    JointAccelerationCheck,
    JointJerkCheck,
    JointPositionCheck,
    JointTorqueCheck,
    JointVelocityCheck,
    MechanismCheck,
    RestCheck,
)
from excite.safety.checks.motion import IdentityCheck, SamplingCheck
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


# The checks that make up a verdict, by name, in the order in which they run.

CHECKS: dict[str, type[Check]] = {
    check.name: check
    for check in (
        SamplingCheck,
        MechanismCheck,
        IdentityCheck,
        RestCheck,
        JointPositionCheck,
        JointVelocityCheck,
        JointAccelerationCheck,
        JointJerkCheck,
        FootCheck,
        ZeroMomentPointCheck,
        CentreOfMassCheck,
        ContactWrenchCheck,
        JointTorqueCheck,
        SelfCollisionCheck,
    )
}
add_installed("checks", CHECKS)
