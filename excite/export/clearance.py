"""What a motion has to pass before it leaves for a controller."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from excite.arrays import Array
from excite.display import percent
from excite.errors import InputError, MotionError, UnsafeMotionError
from excite.export.exporter import SINGLE, Exporter, join_motions, motion_rows
from excite.formats.number import check_number
from excite.motion.content import with_verdict
from excite.motion.motion import Motion, interpolate_motion
from excite.motion.setpoints import SLOWEST_SAMPLES_HZ
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.checks.motion import coordinate_names
from excite.safety.repairs.collisions import find_route
from excite.safety.repairs.retiming import plan_transfer
from excite.safety.verdict import Verdict
from excite.simulation.rehearsal import rehearsed_verdict

# How far a motion at another rate may be from what it was: shares of each joint's range, velocity limit and
# acceleration limit. The ready motions of seven robots and planned ones of a UR10 lose at most 1e-5, 0.2 % and 2.7 % at
# 20 Hz, the lowest rate that the check accepts, and 6e-7, 0.01 % and 1 % at 50 Hz, where a controller's quintic
# polynomials go through positions, velocities and accelerations: twice that is another motion.
_LOST = {"position": 1e-4, "velocity": 0.005, "acceleration": 0.05}
_WHOLE = {"position": "range", "velocity": "limit", "acceleration": "limit"}

# What no file holds, or of which nothing can be said: not written for any reason.
_UNWRITABLE = {"shape", "joint_order", "not_finite", "time_not_increasing", "too_few_samples"}

OVERRIDE = "--unsafe-anyway REASON (unsafe_anyway in Python) is the only way round"


@dataclass(frozen=True, eq=False)
class Cleared:
    """A motion as it is written for a controller, and what was said of it.

    Attributes:
        motion: on the controller's grid; its metadata carry the verdict, and the reason where it is not safe.
        verdict: of the independent check, on what is written.
        reason: why it is written all the same; None where it is safe.
    """

    motion: Motion
    verdict: Verdict
    reason: str | None


def clear_motions(
    exporters: Sequence[Exporter],
    motions: Sequence[Motion],
    rate_hz: float | None = None,
    unsafe_anyway: str | None = None,
    *,
    approach: bool = False,
) -> list[Cleared]:
    """Judge motions anew, as they will be written, before any of them is.

    Args:
        exporters: what shall write each motion, for its robot.
        motions: what shall leave.
        rate_hz: rate of the files; None for the controller's, or each motion's own samples.
        unsafe_anyway: why motions that fail are written all the same; None where they are not.
        approach: whether the way from the robot's rest posture and back is part of each.

    Raises:
        UnsafeMotionError: the check does not find one safe, as it is or at ``rate_hz``, and there is no reason to write
            it all the same. It carries the verdicts on all that fail.
        MotionError: the joints are not the robot's.
        InputError: the rate loses a motion, or is no rate, of the controller or at all; the controller does not run
            such a robot; the reason is blank.
    """
    if unsafe_anyway is not None and not unsafe_anyway.strip():
        raise InputError("is blank", field="unsafe_anyway", remedy="say why, for whoever finds the files")
    for exporter, motion in zip(exporters, motions, strict=True):
        exporter.refuse(motion)
    if approach:
        motions = [
            with_approach(exporter.robot, motion) for exporter, motion in zip(exporters, motions, strict=True)
        ]
    named = {motion.name: motion for motion in motions}
    cleared = [
        _clear_motion(exporter, motion, named, rate_hz, unsafe_anyway)
        for exporter, motion in zip(exporters, motions, strict=True)
    ]
    failed = [item.verdict for item in cleared if not item.verdict.safe]
    broken = next((verdict for verdict in failed if _is_unwritable(verdict)), None)
    if broken is not None and unsafe_anyway is not None:
        raise UnsafeMotionError(
            broken.summary(),
            verdicts=failed,
            remedy="nothing was written, and no reason would change that: nobody can run it",
        )
    if failed and unsafe_anyway is None:
        more = (
            f", and {len(failed) - 1} more of {len(cleared)} motions are not safe" if len(failed) > 1 else ""
        )
        raise UnsafeMotionError(
            f"{failed[0].summary()}{more}", verdicts=failed, remedy=f"nothing was written; {OVERRIDE}"
        )
    return cleared


def _clear_motion(
    exporter: Exporter,
    motion: Motion,
    named: Mapping[str, Motion],
    asked_hz: float | None,
    reason: str | None,
) -> Cleared:
    robot = exporter.robot
    if motion.joint_names != robot.joint_names:
        raise MotionError(
            f"its joints are not those of robot {robot.name!r}",
            source=motion.name,
            remedy="export it with its robot",
        )
    verdict = check_motion(robot, motion, neighbours=named)
    if _is_unwritable(verdict):
        return Cleared(motion, verdict, reason)
    rate_hz = exporter.rate(motion, asked_hz)
    written = motion
    if rate_hz is not None:
        written = on_grid(motion, robot, rate_hz)
        # What is not safe does not leave at any rate, and what cannot be read cannot be compared.
        if verdict.safe or (verdict.readable and reason is not None):
            _check_loss(robot, motion, written, rate_hz)
        if verdict.safe:
            verdict = check_motion(robot, written, neighbours=named)
    # What is written is the motion to within what a rate may lose, so that the motion's own rehearsal holds.
    verdict = rehearsed_verdict(robot, motion, verdict)
    verdict = replace(verdict, violations=(*verdict.violations, *exporter.violations(written)))
    said = dict(verdict.to_json())
    if not verdict.safe and reason is not None:
        said["unsafe_anyway"] = reason
    metadata = replace(written.metadata, robot_hash=robot.hash, stated_hash="")
    sealed = with_verdict(replace(written, robot=robot.name, metadata=metadata), said, robot.hash)
    return Cleared(sealed, verdict, None if verdict.safe else reason)


def _is_unwritable(verdict: Verdict) -> bool:
    return any(violation.kind in _UNWRITABLE for violation in verdict.violations)


def _check_loss(robot: Robot, motion: Motion, written: Motion, rate_hz: float) -> None:
    """Refuse a rate at which what lies between the samples is another motion; raises InputError."""
    lost = rate_loss(robot, motion, written)
    names = coordinate_names(robot)[robot.n_base_v :]
    for quantity, limit in _LOST.items():
        column = int(np.argmax(lost[quantity]))
        if lost[quantity][column] > limit:
            raise InputError(
                f"at {rate_hz:g} Hz the {quantity} of {names[column]} is off by up to"
                f" {percent(100.0 * lost[quantity][column])} of its {_WHOLE[quantity]}, more than {100.0 * limit:g} %",
                source=motion.name,
                field="rate_hz",
                remedy=f"give a higher rate; its own is {(motion.n_samples - 1) / motion.duration:.4g} Hz",
            )


def rate_loss(robot: Robot, motion: Motion, written: Motion) -> dict[str, np.ndarray]:
    """Largest distance between a motion and what a controller interpolates from its samples at another rate.

    Args:
        robot: their robot.
        motion: the motion.
        written: the same at another rate, from time zero.

    Returns:
        ``position``, ``velocity`` and ``acceleration``, ``(n_joints,)`` each, as shares of each joint's range, velocity
        limit and acceleration limit.
    """
    limits = robot.limits
    # Four instants for each sample of the finer of the two.
    n = 4 * max(motion.n_samples, written.n_samples)
    time = np.linspace(0.0, min(motion.duration, written.duration), n)
    there = interpolate_motion(written, robot, written.time[0] + time)
    here = interpolate_motion(motion, robot, motion.time[0] + time)
    return {
        "position": np.abs(there.joint_positions() - here.joint_positions()).max(axis=0)
        / (limits.position_upper - limits.position_lower),
        "velocity": np.abs(there.joint_velocities() - here.joint_velocities()).max(axis=0) / limits.velocity,
        "acceleration": np.abs(there.joint_accelerations() - here.joint_accelerations()).max(axis=0)
        / limits.acceleration,
    }


# The way from the robot's rest posture to where a motion starts, and back from where it ends.

# Nearer to rest than single precision keeps a turn apart [rad or m], a motion needs no way there.
_NEAR = 2.0 * math.pi * SINGLE
# Speeds at which a way is tried, as shares of half of each limit: slower ones where the torques do not suffice.
_SPEEDS = (1.0, 0.5, 0.25)


def with_approach(robot: Robot, motion: Motion) -> Motion:
    """The motion from and to the robot's rest posture.

    The joints go straight, as fast as half of their velocity, acceleration and jerk limits let them; round the
    robot's own bodies in several straight parts, each from rest to rest, where they would touch. Which way is taken,
    and how fast, depends on what the independent check says of it; where it likes none, the straight way stands there
    and the check refuses the whole. Ends that another motion of a chain goes on from stay as they are.

    Args:
        robot: its robot.
        motion: the motion; one that is broken, or of other joints, comes back as it is.

    Raises:
        InputError: it starts or ends elsewhere than at rest, and the robot stands on feet or its base moves too.
    """
    if not _is_whole(robot, motion):
        return motion
    start = None if motion.metadata.previous else _approach_way(robot, motion, 0)
    end = None if motion.metadata.following else _approach_way(robot, motion, -1)
    if start is None and end is None:
        return motion
    parts, begins = [], 0.0
    if start is not None:
        parts.append(motion_rows(start, slice(None, -1)))
        begins = start.duration
    whole = replace(motion, time=motion.time - motion.time[0] + begins)
    parts.append(whole)
    if end is not None:
        parts.append(motion_rows(replace(end, time=whole.time[-1] + end.time), slice(1, None)))
    return join_motions(motion, parts)


def _is_whole(robot: Robot, motion: Motion) -> bool:
    """Whether there is anything to lead to and from: what is broken, the check says."""
    shapes = motion.q.shape == (motion.n_samples, robot.model.nq) and motion.n_samples > 2
    return (
        shapes
        and motion.joint_names == robot.joint_names
        and bool(np.isfinite(motion.q).all() and (np.diff(motion.time) > 0.0).all())
    )


def _approach_way(robot: Robot, motion: Motion, row: int) -> Motion | None:
    """From rest to the first sample (row 0), or from the last one to rest; None where it is at rest already."""
    rest, there = robot.rest[robot.n_base_q :], motion.q[row, robot.n_base_q :]
    base = motion.q[row, : robot.n_base_q] - robot.rest[: robot.n_base_q]
    if np.abs(motion.q[row] - robot.rest).max() <= _NEAR:
        return None
    if robot.feet or np.abs(base).max(initial=0.0) > _NEAR:
        raise InputError(
            f"{'starts' if row == 0 else 'ends'} away from rest, and only joints can be led there, not feet or a base",
            source=motion.name,
            field="approach",
            remedy="plan it from rest to rest, or leave --approach out",
        )
    start, end = (rest, there) if row == 0 else (there, rest)
    postures = find_route(robot, start, end, np.random.default_rng(0)) or [start, end]
    ways = [_way_along(robot, motion, postures, row, speed) for speed in _SPEEDS]
    unsaid = replace(motion.metadata, previous="", following="", stated_hash="", robot_hash="")
    safe = (
        way
        for way in ways
        if check_motion(robot, replace(way, contacts={}, metadata=unsaid, robot=robot.name)).safe
    )
    return next(safe, ways[0])


def _way_along(robot: Robot, motion: Motion, postures: list[Array], row: int, speed: float) -> Motion:
    """Straight from posture to posture, at rest in each, at a share of what a transfer does; else as in a sample."""
    rate = (motion.n_samples - 1) / motion.duration
    parts = [motion_rows(motion, np.array([row]))]
    parts[0] = _rows_of(robot, parts[0], np.zeros(1), postures[0][None], *np.zeros((2, 1, robot.n_joints)))
    for start, end in pairwise(postures):
        # Sampled more finely by as much as it is stretched afterwards.
        part = plan_transfer(robot, start, end, rate / speed)
        time = parts[-1].time[-1] + part.time[1:] / speed
        parts.append(_rows_of(robot, parts[0], time, part.q[1:], speed * part.v[1:], speed**2 * part.a[1:]))
    return join_motions(motion, parts)


def _rows_of(robot: Robot, sample: Motion, time: Array, q: Array, v: Array, a: Array) -> Motion:
    """Rows of the joints where the base stands still as in a sample, and the feet as they do there."""
    still = np.zeros((len(time), robot.n_base_v))
    return replace(
        sample,
        time=time,
        q=np.hstack([np.repeat(sample.q[:1, : robot.n_base_q], len(time), axis=0), q]),
        v=np.hstack([still, v]),
        a=np.hstack([still, a]),
        contacts={name: np.repeat(flags[:1], len(time)) for name, flags in sample.contacts.items()},
    )


# The uniform grid of samples that a controller runs.

# Of one file: 0.8 GB in memory and twice that as text.
_MOST_NUMBERS = 100_000_000


def on_grid(motion: Motion, robot: Robot, rate_hz: float) -> Motion:
    """The motion from time zero, at exactly ``k / rate_hz`` [s].

    When the duration is no whole number of periods and the motion ends at rest, one more sample holds its
    last posture; when it ends moving, the grid stops at the last whole period.

    Args:
        motion: the motion.
        robot: its robot.
        rate_hz: samples per second.

    Returns:
        The motion on the grid, its q, v, a belonging together.

    Raises:
        InputError: ``rate_hz`` is too low for a controller, or gives more samples than a file holds.
    """
    row = motion.q.shape[1] + motion.v.shape[1] + motion.a.shape[1]
    # Below the lowest rate nobody can tell what a controller would do, and one sample is no motion.
    least, most = max(SLOWEST_SAMPLES_HZ, 1.0 / motion.duration), _MOST_NUMBERS / (row * motion.duration)
    check_number(rate_hz, "rate_hz", least, most, "Hz", source=motion.name)
    periods = motion.duration * rate_hz
    whole = math.floor(periods + 1e-6)
    inside = np.arange(whole + 1) / rate_hz
    sampled = interpolate_motion(motion, robot, np.minimum(motion.time[0] + inside, motion.time[-1]))
    sampled = replace(sampled, time=inside)
    if periods - whole > 1e-6 and np.abs(motion.v[-1]).max() <= SINGLE:
        last = motion_rows(motion, slice(-1, None))
        held = replace(
            last, time=np.array([(whole + 1) / rate_hz]), v=np.zeros_like(last.v), a=np.zeros_like(last.a)
        )
        return join_motions(sampled, [sampled, held])
    return sampled
