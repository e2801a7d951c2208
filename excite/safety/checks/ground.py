"""Checks of the contact with the ground: zero-moment point, centre of mass, contact wrench, feet."""

from __future__ import annotations

from itertools import chain

import numpy as np

from excite.arrays import Array, Flags
from excite.safety.checks.base import CheckResult, first_violation
from excite.safety.checks.sweep import Sweep
from excite.safety.ground_forces import RESIDUAL_TOLERANCE, polygon_margin
from excite.safety.verdict import Violation

# Can the ground hold the robot up: zero-moment point, centre of mass, contact wrench.

# Distance that the zero-moment point and the centre of mass keep from the edge of the support polygon [m].
# Chosen here: a tenth of a humanoid's foot length, and more than the 5 mm by which a stiff position servo
# misses its reference.
ZMP_MARGIN = 0.015
# Smallest share of the weight that the ground must carry: below it the robot is about to jump.
MIN_WEIGHT_SHARE = 0.2
# A contact phase shorter than this is a step, over which the centre of mass may pass outside the feet [s].
STEP_S = 1.5


def judge_zero_moment_point(sweep: Sweep) -> CheckResult:
    """The zero-moment point stays inside the support polygon, at every sample of the finer grid.

    The polygon is the hull of the soles of all feet whose contact flag is set, projected on level ground at
    height zero. The margin is None if the robot has no contact or leaves the ground anywhere.
    """
    robot, time = sweep.robot, sweep.fine.time
    if not robot.feet:
        return CheckResult(applicable=False)
    airborne: Flags = np.logical_not(sweep.contacts.any(axis=1))
    found: tuple[Violation, ...] = ()
    if airborne.any():
        found = (Violation("no_contact", float(time[int(np.argmax(airborne))]), "feet", None, None),)
    share = sweep.wrench[:, 2] / (robot.mass * np.linalg.norm(robot.model.gravity.linear))
    light = np.logical_not(share >= MIN_WEIGHT_SHARE)
    found += first_violation("weight_share", "feet", time, share, MIN_WEIGHT_SHARE, light)
    margin = support_margin(sweep, sweep.zmp)
    outside = margin < ZMP_MARGIN
    found += first_violation("zmp", _name_feet(sweep, outside), time, margin, ZMP_MARGIN, outside)
    smallest = float(margin.min())
    return CheckResult(smallest if np.isfinite(smallest) else None, found)


def judge_centre_of_mass(sweep: Sweep) -> CheckResult:
    """The centre of mass stays above the support polygon, so that the motion may be stopped.

    Judged at the first and the last sample, and throughout every contact phase of at least :data:`STEP_S`;
    in the shorter phases of a walk the zero-moment point alone decides.
    """
    if not sweep.robot.feet:
        return CheckResult(applicable=False)
    time = sweep.fine.time
    margin = support_margin(sweep, sweep.dynamics.com[:, :2])
    outside = ~(margin >= ZMP_MARGIN) & _stance_samples(sweep)
    where = _name_feet(sweep, outside)
    return CheckResult(violations=first_violation("com", where, time, margin, ZMP_MARGIN, outside))


def judge_contact_wrench(sweep: Sweep) -> CheckResult:
    """Forces inside the soles' friction pyramids can supply the whole required wrench.

    Stronger than the zero-moment point: it also excludes slipping and turning on the spot. Evaluated at about
    200 Hz (:data:`~excite.safety.checks.sweep.TORQUE_RATE_HZ`).
    """
    if not sweep.robot.feet:
        return CheckResult(applicable=False)
    residual = sweep.contact_forces[0].residual
    bad = ~(residual <= RESIDUAL_TOLERANCE)
    time = sweep.fine.time[sweep.torque_samples]
    return CheckResult(
        violations=first_violation("contact_wrench", "feet", time, residual, RESIDUAL_TOLERANCE, bad)
    )


def support_margin(sweep: Sweep, points: Array) -> Array:
    """Signed distance of points, ``(n, 2)``, from the support polygon's edge [m]; NaN without contact."""
    margin = np.full(len(points), np.nan)
    for standing in sweep.on_feet(np.arange(len(points))):
        margin[standing.rows] = polygon_margin(standing.corners[:, :, :2], points[standing.rows])
    return margin


def _stance_samples(sweep: Sweep) -> Flags:
    """Samples at which the centre of mass is judged."""
    time, contacts = sweep.fine.time, sweep.contacts
    changes = np.flatnonzero((contacts[1:] != contacts[:-1]).any(axis=1)) + 1
    judged = np.zeros(len(time), dtype=bool)
    judged[[0, -1]] = True
    for samples in np.split(np.arange(len(time)), changes):
        if time[samples[-1]] - time[samples[0]] >= STEP_S:
            judged[samples] = True
    return judged


def _name_feet(sweep: Sweep, bad: Flags) -> str:
    row = sweep.contacts[int(np.argmax(bad))]
    return "+".join(foot.name for foot, flag in zip(sweep.robot.feet, row, strict=True) if flag) or "feet"


# Feet that carry load stay where they are, the others stay above the ground.

# Chosen here, below what a foot's rubber and the ground's unevenness take up:
HEIGHT_TOLERANCE = 0.003  # height of a loaded sole's corner above or below the ground [m]
SLIP_TOLERANCE = 0.003  # way of a loaded sole's corner from where it was put down [m]
SLIP_SPEED_TOLERANCE = 0.03  # its horizontal speed [m/s]


def judge_feet(sweep: Sweep) -> CheckResult:
    """Soles against level ground at height zero, at every sample of the finer grid.

    While a foot's contact flag is set, each corner of its sole stays within 3 mm of the ground and within 3
    mm horizontally of where the phase began, and moves at no more than 0.03 m/s. While it is not set no
    corner is more than 3 mm below the ground.
    """
    if not sweep.robot.feet:
        return CheckResult(applicable=False)
    found: tuple[Violation, ...] = ()
    for i, foot in enumerate(sweep.robot.feet):
        found += _judge_foot(foot.name, sweep.fine.time, sweep.sole_corners[i], sweep.contacts[:, i])
    return CheckResult(violations=found)


def _judge_foot(name: str, time: Array, corners: Array, loaded: Flags) -> tuple[Violation, ...]:
    low, high = corners[:, :, 2].min(axis=1), corners[:, :, 2].max(axis=1)
    slip, speed = np.zeros(len(time)), np.zeros(len(time))
    # A phase starts where the flag rises.
    starts = np.flatnonzero(loaded & ~np.r_[False, loaded[:-1]])
    for start in starts:
        end = start + int(np.argmin(loaded[start:])) if not loaded[start:].all() else len(time)
        ground = corners[start:end, :, :2]
        slip[start:end] = np.linalg.norm(ground - ground[0], axis=2).max(axis=1)
        step = np.linalg.norm(np.diff(ground, axis=0), axis=2).max(axis=1)
        speed[start : end - 1] = step / np.diff(time[start:end])
    cases = (
        ("foot_lifted", loaded & ~(high <= HEIGHT_TOLERANCE), high, HEIGHT_TOLERANCE),
        ("foot_below_ground", ~(low >= -HEIGHT_TOLERANCE), low, -HEIGHT_TOLERANCE),
        ("foot_slip", loaded & ~(slip <= SLIP_TOLERANCE), slip, SLIP_TOLERANCE),
        ("foot_slip_speed", loaded & ~(speed <= SLIP_SPEED_TOLERANCE), speed, SLIP_SPEED_TOLERANCE),
    )
    found = (first_violation(kind, name, time, values, limit, bad) for kind, bad, values, limit in cases)
    return tuple(chain.from_iterable(found))
