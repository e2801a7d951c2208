"""Checks of the motion itself: sampling, consistency of q, v and a, and the robot that it is of."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import MotionError
from excite.motion.motion import Motion
from excite.motion.setpoints import LONGEST_GOAL_S, SLOWEST_SAMPLES_HZ, is_sparse
from excite.robot.robot import Robot
from excite.safety.checks.base import CheckResult, first_violations
from excite.safety.checks.sweep import Sweep
from excite.safety.verdict import Violation

# Is the motion readable at all, and do its q, v and a belong together?

# Longest step between samples relative to the median one: more is a gap in which anything may happen.
_STEP_RATIO = 1.5
# Shortest step relative to the median one: a clock jitters far less, and derivatives over less of a step say nothing.
_SHORTEST_STEP = 0.01
# How far v and a may be from the derivatives of q and v, relative to the joints' limits; chosen here: a tenth
# of what would matter to a limit, a hundred times what rounding and interpolation at 100 Hz leave.
_VELOCITY_TOLERANCE = 0.005
_ACCELERATION_TOLERANCE = 0.01
# The same for a base: linear [m/s, m/s²], angular [rad/s, rad/s²].
_BASE_VELOCITY_TOLERANCE = (0.01, 0.02)
_BASE_ACCELERATION_TOLERANCE = (0.2, 0.3)


def judge_sampling(sweep: Sweep) -> CheckResult:
    """Shapes, joint order, finite values, time, contact flags, and v, a as derivatives of q.

    The first five kinds leave nothing that could be computed (``readable`` is False). The derivatives are
    judged interval by interval against the corrected trapezoidal rule,
    ``Δq/h = (v₀+v₁)/2 − h(a₁−a₀)/12 + O(h⁴)`` and ``Δv/h = (a₀+a₁)/2 + O(h²)``, with room for an acceleration
    that jumps once inside the interval, as time-optimal motions do.
    """
    robot, motion = sweep.robot, sweep.motion
    for broken in (_check_structure(robot, motion), _check_values(motion), time_faults(motion)):
        if broken:
            return CheckResult(violations=broken, readable=False)
    contacts = _check_contacts(robot, motion)
    if contacts:
        return CheckResult(violations=contacts, readable=False)
    # Between setpoints a controller runs the curve that these ask for, whatever it does.
    return CheckResult(violations=() if motion.is_goal else _check_derivatives(robot, motion))


def coordinate_names(robot: Robot) -> tuple[str, ...]:
    """Names of the columns of v: the base's six, if it is free, and the joints."""
    base = ("base.x", "base.y", "base.z", "base.wx", "base.wy", "base.wz") if robot.floating else ()
    return base + robot.joint_names


def velocity_tolerance(robot: Robot) -> Array:
    """How far velocities may be from what they should be, ``(nv,)`` [m/s and rad/s of a base; rad/s or m/s]."""
    return _derivative_tolerances(robot)[0]


def _check_structure(robot: Robot, motion: Motion) -> tuple[Violation, ...]:
    if motion.joint_names != robot.joint_names:
        pairs = zip(motion.joint_names, robot.joint_names, strict=False)
        wrong = next((found for found, expected in pairs if found != expected), "number of joints")
        return (Violation("joint_order", None, wrong, None, None),)
    n, model = len(motion.time), robot.model
    shapes = {"q": (motion.q, model.nq), "v": (motion.v, model.nv), "a": (motion.a, model.nv)}
    return tuple(
        Violation("shape", None, name, None, None)
        for name, (x, width) in shapes.items()
        if x.shape != (n, width)
    )


def _check_values(motion: Motion) -> tuple[Violation, ...]:
    for name, values in (("time", motion.time), ("q", motion.q), ("v", motion.v), ("a", motion.a)):
        finite = np.isfinite(values).reshape(len(values), -1)
        if not finite.all():
            row, column = (int(i) for i in np.argwhere(~finite)[0])
            time = float(motion.time[row])
            where = name if name == "time" else _column_name(motion, name, column)
            return (Violation("not_finite", time if np.isfinite(time) else None, where, None, None),)
    if motion.floating:
        error = np.abs(np.linalg.norm(motion.q[:, 3:7], axis=1) - 1.0)
        if error.max(initial=0.0) > 1e-6:
            row = int(np.argmax(error > 1e-6))
            return (
                Violation("quaternion_norm", float(motion.time[row]), "base", float(1.0 + error[row]), 1.0),
            )
    return ()


def _column_name(motion: Motion, name: str, column: int) -> str:
    joint = column - ((motion.q if name == "q" else motion.v).shape[1] - len(motion.joint_names))
    return f"{name}.{motion.joint_names[joint]}" if joint >= 0 else f"base ({name})"


def time_faults(motion: Motion) -> tuple[Violation, ...]:
    """What keeps a motion's samples from being a motion in time, at most one thing: order, rate, gaps."""
    time = motion.time
    if len(time) < 3:
        return (Violation("too_few_samples", None, "time", float(len(time)), 3.0),)
    step = np.diff(time)
    median = float(np.median(step))
    # No controller takes samples faster than one a microsecond.
    shortest, longest = (
        max(_SHORTEST_STEP * median, 1e-6),
        min(_STEP_RATIO * median, 1.0 / SLOWEST_SAMPLES_HZ),
    )
    sparse = not motion.is_goal and is_sparse(time)
    cases = [("time_not_increasing", step <= 0.0, 0.0)]
    if motion.is_goal:
        too_long = (step == step.max()) & (motion.duration > LONGEST_GOAL_S)
        cases.append(("time_gap", too_long, LONGEST_GOAL_S))
    elif not sparse:
        cases += [
            ("time_step", step < shortest, shortest),
            ("time_gap", step > longest * (1.0 + 1e-9), longest),
        ]
    for kind, bad, limit in cases:
        if bad.any():
            k = int(np.argmax(bad))
            return (Violation(kind, float(time[k]), "time", float(step[k]), limit),)
    return (Violation("rate_too_low", None, "time", 1.0 / median, SLOWEST_SAMPLES_HZ),) if sparse else ()


def refuse_time_faults(motion: Motion) -> None:
    """Raise MotionError for samples that are no motion in time."""
    for fault in time_faults(motion):
        raise MotionError(
            f"cannot be run: {fault}",
            source=motion.name,
            field="time",
            remedy="resample it evenly, 20 Hz or faster, without gaps",
        )


def _check_contacts(robot: Robot, motion: Motion) -> tuple[Violation, ...]:
    found = []
    for foot in robot.feet:
        flags = motion.contacts.get(foot.name)
        if flags is None or np.shape(flags) != motion.time.shape or np.asarray(flags).dtype != np.bool_:
            found.append(Violation("contact_missing", None, foot.name, None, None))
    return tuple(found)


def _check_derivatives(robot: Robot, motion: Motion) -> tuple[Violation, ...]:
    time, v, a = motion.time, motion.v, motion.a
    h = np.diff(time)[:, None]
    if motion.floating:
        pairs = zip(motion.q[:-1], motion.q[1:], strict=True)
        step = np.array([pin.difference(robot.model, first, second) for first, second in pairs])
    else:
        step = np.diff(motion.q, axis=0)
    jump = np.abs(np.diff(a, axis=0))
    v_mean = 0.5 * (v[:-1] + v[1:]) - h * np.diff(a, axis=0) / 12.0
    a_mean = 0.5 * (a[:-1] + a[1:])
    velocity, acceleration = np.abs(step / h - v_mean), np.abs(np.diff(v, axis=0) / h - a_mean)
    v_limit, a_limit = _derivative_tolerances(robot)
    # A single jump of a by Δa inside the interval moves the mean acceleration by at most Δa/2, and the mean
    # velocity against the corrected trapezoidal rule by at most h·Δa/12.
    v_limit, a_limit = v_limit + h * jump / 12.0, a_limit + 0.5 * jump
    if len(a) > 3:
        # Smooth curvature of a makes the trapezoidal rule err by a 24th of this; twice that is let be.
        bend = np.abs(a[:-3] - a[1:-2] - a[2:-1] + a[3:])
        a_limit = a_limit + np.pad(bend, ((1, 1), (0, 0)), mode="edge") / 12.0
    names = coordinate_names(robot)
    return first_violations(
        "velocity_not_derivative", names, time, velocity, v_limit, velocity > v_limit
    ) + first_violations(
        "acceleration_not_derivative", names, time, acceleration, a_limit, acceleration > a_limit
    )


def _derivative_tolerances(robot: Robot) -> tuple[Array, Array]:
    velocity = _VELOCITY_TOLERANCE * robot.limits.velocity
    acceleration = _ACCELERATION_TOLERANCE * robot.limits.acceleration
    if not robot.floating:
        return velocity, acceleration
    base_v, base_a = np.repeat(_BASE_VELOCITY_TOLERANCE, 3), np.repeat(_BASE_ACCELERATION_TOLERANCE, 3)
    return np.concatenate([base_v, velocity]), np.concatenate([base_a, acceleration])


# Is it this robot's motion, and the one that was judged?


def judge_identity(sweep: Sweep) -> CheckResult:
    """What a motion's file says of its robot and of its samples has to be so.

    A motion of another robot, or of this one with another description, geometry or limits, may fit by its joints' names
    and hit something all the same. Samples that are not those of the stated hash were changed by somebody who judged
    nothing. A motion that states neither, as one that was made elsewhere, is judged by its samples alone.
    """
    robot, motion = sweep.robot, sweep.motion
    found = []
    if motion.robot != robot.name:
        found.append(Violation("other_robot", None, motion.robot, None, None))
    elif motion.metadata.robot_hash and motion.metadata.robot_hash != robot.hash:
        found.append(Violation("other_version_of_robot", None, motion.robot, None, None))
    if motion.metadata.stated_hash:
        found.append(Violation("changed_since_written", None, "samples", None, None))
    return CheckResult(violations=tuple(found))
