"""Two hundred motions that must not be run, each a safe one with one thing wrong, and safe ones beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from excite.campaign.plan import plan
from excite.motion.motion import Motion
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.checks.joints import drive_torques
from excite.safety.checks.sweep import Sweep
from tests.benchmarks.table import Row
from tests.safety.motions import moved_base, smooth

Case = tuple[Robot, Motion]
# By how much a limit is passed.
_BY = 1.01


def rows() -> list[Row]:
    """How many of the spoilt motions are refused, how many for the right reason, and how many good ones are not."""
    right, refused, spoilt, good, kept = 0, 0, 0, 0, 0
    wrong: set[str] = set()
    for name, count in (("g1", 14), ("ur10", 8)):
        robot = load_robot(name)
        for motion in plan(robot, n_candidates=count, seed=11, jobs=2).accepted[:12]:
            good += 1
            kept += check_motion(robot, motion).safe
            for kind, spoil in FAULTS.items():
                case = spoil(robot, motion)
                if case is None:
                    continue
                verdict = check_motion(*case)
                spoilt += 1
                refused += not verdict.safe
                reason = bool(
                    ALLOWED.get(kind, {kind}) & {violation.kind for violation in verdict.violations}
                )
                right += reason
                if not reason:
                    wrong.add(kind)
    others = f" (not: {', '.join(sorted(wrong))})" if wrong else ""
    return [
        Row.holds(
            f"motions with one thing wrong, {len(FAULTS)} kinds: refused",
            "all",
            f"{refused} of {spoilt}",
            refused == spoilt,
        ),
        Row.holds("… and for the right reason", "all", f"{right} of {spoilt}{others}", right == spoilt),
        Row.at_most("good motions refused", 100.0 * (good - kept) / good, 2.0, "%"),
    ]


def _limits(robot: Robot, **limits: np.ndarray) -> Robot:
    return replace(robot, limits=replace(robot.limits, **limits))


def _position(robot: Robot, motion: Motion) -> Case:
    joint = int(np.argmax(np.ptp(motion.joint_positions(), axis=0)))
    upper, peak = robot.limits.position_upper.copy(), motion.joint_positions()[:, joint].max()
    upper[joint] = peak - (_BY - 1.0) * np.ptp(motion.joint_positions()[:, joint])
    return _limits(robot, position_upper=upper), motion


def _rate(field: str, values: Callable[[Motion], np.ndarray]) -> Callable[[Robot, Motion], Case]:
    def spoil(robot: Robot, motion: Motion) -> Case:
        peak = np.abs(values(motion)).max(axis=0)
        limit = getattr(robot.limits, field).copy()
        joint = int(np.argmax(peak / limit))
        limit[joint] = peak[joint] / _BY
        return _limits(robot, **{field: limit}), motion

    return spoil


def _torque(robot: Robot, motion: Motion) -> Case:
    peak = np.abs(drive_torques(Sweep(robot, motion))).max(axis=0)
    limit = robot.limits.torque.copy()
    joint = int(np.argmax(peak / limit))
    limit[joint] = peak[joint] / _BY
    return _limits(robot, torque=limit), motion


def _collision(robot: Robot, motion: Motion) -> Case:
    closest = check_motion(robot, motion).margins.self_collision_m
    collision = robot.description.collision.model_copy(update={"margin": closest + 0.003})
    return replace(robot, description=robot.description.model_copy(update={"collision": collision})), motion


def _value(field: str, row: float, value: float) -> Callable[[Robot, Motion], Case]:
    def spoil(robot: Robot, motion: Motion) -> Case:
        values = getattr(motion, field).copy()
        values[int(row * len(values)), -1] = value
        return robot, replace(motion, **{field: values})

    return spoil


def _unsorted(robot: Robot, motion: Motion) -> Case:
    time = motion.time.copy()
    time[[50, 51]] = time[[51, 50]]
    return robot, replace(motion, time=time)


def _gap(robot: Robot, motion: Motion) -> Case:
    keep = np.r_[0:100, 160 : motion.n_samples]
    contacts = {name: flags[keep] for name, flags in motion.contacts.items()}
    arrays = {name: getattr(motion, name)[keep] for name in ("time", "q", "v", "a")}
    return robot, replace(motion, contacts=contacts, **arrays)


def _order(robot: Robot, motion: Motion) -> Case:
    return robot, replace(motion, joint_names=motion.joint_names[::-1])


def _faster(robot: Robot, motion: Motion) -> Case:
    k = 4.0
    return robot, replace(motion, time=motion.time / k, v=k * motion.v, a=k**2 * motion.a)


def _hill(motion: Motion, height: float) -> np.ndarray:
    s = (motion.time - motion.time[0]) / motion.duration
    return height * smooth(2.5 * s) * smooth(2.5 * (1.0 - s))


def _base(axis: int, height: float) -> Callable[[Robot, Motion], Case | None]:
    def spoil(robot: Robot, motion: Motion) -> Case | None:
        # A foot in the air hides nothing, but a motion along the world's axes needs a level base.
        if not robot.feet or np.abs(motion.q[:, 3:6]).max() > 1e-6:
            return None
        offset = np.zeros((motion.n_samples, 3))
        offset[:, axis] = _hill(motion, height)
        return robot, moved_base(motion, offset)

    return spoil


def _ice(robot: Robot, motion: Motion) -> Case | None:
    if not robot.feet:
        return None
    return replace(robot, feet=tuple(replace(foot, friction=0.002) for foot in robot.feet)), motion


def _flying(robot: Robot, motion: Motion) -> Case | None:
    if not robot.feet:
        return None
    flags = {name: values.copy() for name, values in motion.contacts.items()}
    for values in flags.values():
        values[200:210] = False
    return robot, replace(motion, contacts=flags)


def _one_foot(robot: Robot, motion: Motion) -> Case | None:
    if not robot.feet or not all(flags.all() for flags in motion.contacts.values()):
        return None
    flags = dict(motion.contacts) | {robot.feet[0].name: np.zeros(motion.n_samples, dtype=bool)}
    return robot, replace(motion, contacts=flags)


FAULTS: dict[str, Callable[[Robot, Motion], Case | None]] = {
    "joint_position": _position,
    "joint_velocity": _rate("velocity", lambda motion: motion.joint_velocities()),
    "joint_acceleration": _rate("acceleration", lambda motion: motion.joint_accelerations()),
    "joint_torque": _torque,
    "self_collision": _collision,
    "not_finite": _value("q", 0.5, np.nan),
    "not_finite acceleration": _value("a", 0.3, np.inf),
    "time_not_increasing": _unsorted,
    "time_gap": _gap,
    "joint_order": _order,
    "velocity_not_derivative": lambda robot, motion: (robot, replace(motion, v=1.1 * motion.v)),
    "acceleration_not_derivative": lambda robot, motion: (robot, replace(motion, a=0.0 * motion.a)),
    "too fast": _faster,
    "foot_slip": _base(0, 0.008),
    "foot_lifted": _base(2, 0.01),
    "foot_below_ground": _base(2, -0.01),
    "contact_wrench": _ice,
    "no_contact": _flying,
    "com": _one_foot,
}
# Reasons that are right where the name of the fault is not itself the reason.
ALLOWED = {
    "not_finite acceleration": {"not_finite"},
    "too fast": {
        "joint_velocity",
        "joint_acceleration",
        "joint_torque",
        "zmp",
        "contact_wrench",
        "weight_share",
    },
}
