"""What a motion has to pass before it leaves for a controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from excite.errors import InputError, MotionError, UnsafeMotionError
from excite.export.approach import with_approach
from excite.export.exporter import Exporter
from excite.export.grid import on_grid
from excite.motion.content import with_verdict
from excite.motion.motion import Motion, interpolate_motion
from excite.motion.setpoints import SLOWEST_SAMPLES_HZ
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.checks.sampling import coordinate_names
from excite.safety.verdict import Verdict
from excite.shown import percent

# How far a motion at another rate may be from what it was: shares of each joint's range, velocity limit and
# acceleration limit. The ready motions of seven robots and planned ones of a UR10 lose at most 1e-5, 0.2 % and 2.7 % at
# 20 Hz, the lowest rate that the check accepts, and 6e-7, 0.01 % and 1 % at 50 Hz, where a controller's quintic
# polynomials go through positions, velocities and accelerations: twice that is another motion.
_LOST = {"position": 1e-4, "velocity": 0.005, "acceleration": 0.05}
_WHOLE = {"position": "range", "velocity": "limit", "acceleration": "limit"}
# Instants at which both are compared, for each sample of the finer of the two.
_COMPARED = 4

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
        _check_rate(motion, rate_hz)
        written = on_grid(motion, robot, rate_hz)
        # What is not safe does not leave at any rate, and what cannot be read cannot be compared.
        if verdict.safe or (verdict.readable and reason is not None):
            _check_loss(robot, motion, written, rate_hz)
        if verdict.safe:
            verdict = check_motion(robot, written, neighbours=named)
    verdict = replace(verdict, violations=(*verdict.violations, *exporter.violations(written)))
    said = dict(verdict.to_json())
    if not verdict.safe and reason is not None:
        said["unsafe_anyway"] = reason
    metadata = replace(written.metadata, robot_hash=robot.hash, stated_hash="")
    sealed = with_verdict(replace(written, robot=robot.name, metadata=metadata), said, robot.hash)
    return Cleared(sealed, verdict, None if verdict.safe else reason)


def _check_rate(motion: Motion, rate_hz: float) -> None:
    if rate_hz < SLOWEST_SAMPLES_HZ:
        raise InputError(
            f"is {rate_hz:g} Hz, and below {SLOWEST_SAMPLES_HZ:g} Hz nobody can tell what a controller would do",
            source=motion.name,
            field="rate_hz",
            remedy=f"give at least {SLOWEST_SAMPLES_HZ:g} Hz",
        )


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
    n = _COMPARED * max(motion.n_samples, written.n_samples)
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
