"""Checks of the joints: limits, torques, rest at both ends, mechanisms."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from excite.arrays import Array
from excite.errors import MotionError
from excite.motion.files import thinned
from excite.motion.motion import Motion
from excite.robot.joint_values import per_joint
from excite.robot.robot import Robot
from excite.safety.checks.base import CheckResult, first_violations, nearest_joints
from excite.safety.checks.control_points import jerk_bounds
from excite.safety.checks.motion import coordinate_names, velocity_tolerance
from excite.safety.checks.sweep import FINER, MIN_RATE_HZ, Sweep
from excite.safety.ground_forces import RESIDUAL_TOLERANCE
from excite.safety.verdict import Violation

# Position, velocity, acceleration and jerk limits of the joints, at every instant.
#
# The first three bound the Bézier control points of the interpolant on the finer grid (see
# :mod:`~excite.safety.checks.control_points`), so nothing passes its limit between samples.

# Rounding that a motion planned exactly to a limit may show, relative to the limit (to the range for
# positions).
_ROUNDING = 1e-6


def judge_positions(sweep: Sweep) -> CheckResult:
    """Joints stay inside their range."""
    limits, low, high = sweep.robot.limits, sweep.bounds.lowest, sweep.bounds.highest
    lower = limits.while_between("position_lower", low, high)
    upper = limits.while_between("position_upper", low, high)
    below, above = lower - low, high - upper
    excess = np.maximum(below, above)
    bad = excess > _ROUNDING * (limits.position_upper - limits.position_lower)
    values = np.where(below > above, low, high)
    passed = np.where(below > above, lower, upper)
    names, time = sweep.robot.joint_names, sweep.fine.time
    return CheckResult(
        float(-excess.max()),
        first_violations("joint_position", names, time, values, passed, bad),
        nearest=nearest_joints("joint_position", sweep.robot, -excess.max(axis=0)),
    )


def judge_rates(quantity: str, sweep: Sweep) -> CheckResult:
    """Joint speeds, or accelerations, stay below their limits, those that depend on positions too."""
    bounds = sweep.bounds
    values = bounds.speed if quantity == "velocity" else bounds.acceleration
    limits = sweep.robot.limits.while_between(quantity, bounds.lowest, bounds.highest)
    return magnitude_result(f"joint_{quantity}", sweep, values, limits)


def judge_jerks(sweep: Sweep) -> CheckResult:
    """Accelerations change no faster than the jerk limit lets them, at the start and the end from and to rest.

    Of dense samples the mean jerk from sample to sample is judged, which is never more than the motion's own: what is
    between them follows from rounded or smoothed derivatives. Samples that are further apart say less than the curve
    through them, whose control points are bounded. Of positions alone the jerk is that of the spline through no more
    than :data:`~excite.safety.checks.sweep.MIN_RATE_HZ` of them a second: six decimals at 500 Hz are 500 rad/s³.
    """
    motion, own = sweep.motion, (sweep.motion.n_samples - 1) / sweep.motion.duration
    if own * FINER < MIN_RATE_HZ * (1.0 - _ROUNDING):
        motion = sweep.fine
        values = jerk_bounds(motion)
    else:
        if motion.curve == "spline" and own >= 2.0 * MIN_RATE_HZ:
            motion = thinned(motion, int(own / MIN_RATE_HZ))
        values = np.abs(np.diff(motion.joint_accelerations(), axis=0)) / np.diff(motion.time)[:, None]
    step = np.diff(motion.time)
    for row, neighbour in ((0, motion.metadata.previous), (-1, motion.metadata.following)):
        if not neighbour:
            jump = np.abs(motion.joint_accelerations()[row]) / step[row]
            values[row] = np.maximum(values[row], jump)
    return magnitude_result("joint_jerk", sweep, values, sweep.robot.limits.jerk, motion.time)


def magnitude_result(
    kind: str, sweep: Sweep, values: Array, limits: Array, time: Array | None = None
) -> CheckResult:
    """Judge magnitudes on intervals, ``(n-1, n_joints)``, of the finer grid or of times, against each joint's limit."""
    bad = ~(values <= limits * (1.0 + _ROUNDING))
    time = sweep.fine.time if time is None else time
    violations = first_violations(kind, sweep.robot.joint_names, time, values, limits, bad)
    room = limits - values
    nearest = nearest_joints(kind, sweep.robot, room.min(axis=0))
    return CheckResult(float(room.min()), violations, nearest=nearest)


# Joints that no motor drives are where the motors put them.

# How far a closure may be open between samples [m or rad]: a hundredth of the clearance that collision checks keep,
# and some hundred times what quintic interpolation leaves at 25 Hz.
TOLERANCE = 1e-4


def judge_mechanism(sweep: Sweep) -> CheckResult:
    """Loops are closed and coupled joints move together, so that what follows from them can be believed.

    Motions whose mechanism is open tell of a robot that does not exist; near a singular position its joints do not
    follow from the motors, and nothing about their torques can be computed.
    """
    mechanism = sweep.robot.mechanism
    if mechanism is None:
        return CheckResult()
    gaps, time = mechanism.closure_gaps(sweep.fine.q), sweep.fine.time
    worst = int(np.argmax(gaps > TOLERANCE))
    if gaps[worst] > TOLERANCE:
        where = mechanism.widest_closure(sweep.fine.q[worst])
        found = Violation("mechanism_open", float(time[worst]), where, float(gaps[worst]), TOLERANCE)
        return CheckResult(violations=(found,), readable=False)
    try:
        mechanism.motion_maps(sweep.fine.q)
    except MotionError as error:
        found = Violation("mechanism_singular", None, error.field or "loops", None, None)
        return CheckResult(violations=(found,), readable=False)
    return CheckResult()


# Motions start and end at rest, or where another one ends and starts.

# How far apart the ends of two motions of a chain may be [rad or m]: what single precision leaves of a turn is 2e-7.
_APART = 1e-5


def judge_rest(sweep: Sweep) -> CheckResult:
    """Velocities of joints and base at the first and the last sample.

    A controller that is handed a motion starts it from a standing robot and stops where it ends. What counts as
    standing is what :func:`~excite.safety.checks.motion.judge_sampling` lets velocities be off by: half a percent of
    a joint's limit. Motions that start and end at rest, sampled at 50 to 1000 Hz and stripped of all but positions,
    use up to 14 % of that. A motion whose file names the one before or after it may start or end moving, if that one is
    among those that are judged together, names it in turn, and ends or starts in the same posture with the same
    velocities and contacts; and if the chain comes from rest and to rest at its ends.
    """
    robot, motion = sweep.robot, sweep.motion
    names = coordinate_names(robot)
    found: list[Violation] = []
    for row, kind in ((0, "starts_moving"), (-1, "ends_moving")):
        neighbour = _neighbour_name(motion, row)
        speed, limit = np.abs(motion.v[row]), velocity_tolerance(robot)
        if neighbour:
            apart = _open_end(motion, row, sweep.neighbours) or _describe_misfit(
                robot, motion, row, sweep.neighbours[neighbour]
            )
            if apart is not None:
                time = float(motion.time[row])
                found.append(Violation("chain_does_not_fit", time, f"{neighbour} ({apart})", None, None))
            continue
        for column in np.flatnonzero(~(speed <= limit)):
            value = float(speed[column])
            found.append(Violation(kind, float(motion.time[row]), names[column], value, float(limit[column])))
    return CheckResult(violations=tuple(found))


def _open_end(motion: Motion, row: int, others: Mapping[str, Motion]) -> str | None:
    """What keeps a chain from coming from rest (row 0) or to rest (row -1): a motion that is not there, or a ring."""
    seen, name = {motion.name}, _neighbour_name(motion, row)
    while name:
        if name not in others:
            return "not among the motions checked"
        if name in seen:
            return "leads back to itself and never rests"
        seen.add(name)
        name = _neighbour_name(others[name], row)
    return None


def _neighbour_name(motion: Motion, row: int) -> str:
    return motion.metadata.previous if row == 0 else motion.metadata.following


def _describe_misfit(robot: Robot, motion: Motion, row: int, neighbour: Motion) -> str | None:
    """What keeps a motion's first (row 0) or last (row -1) sample from being where its neighbour ends or starts."""
    if neighbour.joint_names != motion.joint_names:
        return "has other joints"
    back = neighbour.metadata.following if row == 0 else neighbour.metadata.previous
    if back != motion.name:
        return "does not name it"
    other = -1 if row == 0 else 0
    if not _is_near(motion.q[row], neighbour.q[other], np.full(motion.q.shape[1], _APART)):
        return "is in another posture there"
    if not _is_near(motion.v[row], neighbour.v[other], velocity_tolerance(robot)):
        return "moves otherwise there"
    for foot, flags in motion.contacts.items():
        flag = neighbour.contacts.get(foot)
        if flag is None or flag[other] != flags[row]:
            return "stands on other feet there"
    return None


def _is_near(a: Array, b: Array, tolerance: Array) -> bool:
    return a.shape == b.shape and bool((np.abs(a - b) <= tolerance).all())


# Torque limits of the joints, with the ground's forces in the legs.


def judge_torques(sweep: Sweep) -> CheckResult:
    """Drive torques stay below their limits: ``τ = RNEA(q, v, a) − Σ Jᵀ f`` plus the drives' own friction
    and inertia.

    Evaluated at about 200 Hz (:data:`~excite.safety.checks.sweep.TORQUE_RATE_HZ`). In single support the
    foot's wrench, and so the torque, is unique; in double support it depends on how the feet share the load,
    and the smallest forces are taken (:func:`~excite.safety.ground_forces.distribute_wrench`). Where the
    contacts cannot carry the motion there is no torque to speak of and the margin is None.
    """
    robot, samples = sweep.robot, sweep.torque_samples
    tau = drive_torques(sweep)
    limits = robot.limits.while_between("torque", sweep.fine.q[samples, robot.n_base_q :])
    bad = ~(np.abs(tau) <= limits) & np.isfinite(tau)
    time = sweep.fine.time[samples]
    violations = first_violations("joint_torque", robot.joint_names, time, np.abs(tau), limits, bad)
    computed = np.isfinite(tau).all() and not (
        bool(robot.feet) and robot.floating and (sweep.contact_forces[0].residual > RESIDUAL_TOLERANCE).any()
    )
    if not computed:
        return CheckResult(violations=violations)
    room = limits - np.abs(tau)
    nearest = nearest_joints("joint_torque", robot, room.min(axis=0))
    return CheckResult(float(room.min()), violations, nearest=nearest)


def drive_torques(sweep: Sweep) -> Array:
    """Torques that the drives must deliver at ``sweep.torque_samples``, ``(m, n_joints)`` [N·m or N]."""
    robot, samples = sweep.robot, sweep.torque_samples
    tau = sweep.dynamics.tau[samples].copy()
    for i, foot in enumerate(robot.feet):
        forces = sweep.contact_forces[i].forces
        corners = sweep.sole_corners[i][samples]
        force, moment = forces.sum(axis=1), np.cross(corners, forces).sum(axis=1)
        # The joints between the base and the foot, of one coordinate each.
        legs = list(robot.model.supports[foot.joint])[2:]
        carried = np.einsum("njk,nk->nj", sweep.dynamics.screws[:, legs], np.hstack([force, moment]))
        tau[:, [robot.model.idx_vs[joint] for joint in legs]] -= carried
    tau = robot.on_motors(sweep.fine.q[samples], tau)
    v, a = sweep.fine.joint_velocities()[samples], sweep.fine.joint_accelerations()[samples]
    drives, nothing = robot.description.drives, np.zeros(robot.n_joints)
    viscous, coulomb, armature = (
        per_joint(block, robot.joint_names, nothing)
        for block in (drives.viscous, drives.coulomb, drives.armature)
    )
    return np.asarray(tau[:, robot.n_base_v :] + viscous * v + coulomb * np.sign(v) + armature * a)
