"""The way from the robot's rest posture to where a motion starts, and back from where it ends."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from excite.arrays import Array
from excite.errors import InputError
from excite.motion.motion import Motion
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.repairs.route import find_route
from excite.safety.repairs.transfers import plan_transfer

# Nearer to rest than single precision keeps a turn apart [rad or m], a motion needs no way there.
_NEAR = 1e-6
# Speeds at which a way is tried, as shares of half of each limit: slower ones where the torques do not suffice.
_SPEEDS = (1.0, 0.5, 0.25)
_SEED = 0


@dataclass(frozen=True, eq=False)
class _Way:
    """Samples of the joints from rest to rest: time [s] from zero, q, v and a ``(n, n_joints)``."""

    time: Array
    q: Array
    v: Array
    a: Array


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
    parts = [part for part in (start, end) if part is not None]
    if not parts:
        return motion
    before, after = start or _empty_way(robot), end or _empty_way(robot)
    time = motion.time - motion.time[0] + before.time[-1]
    base, v_base = robot.n_base_q, robot.n_base_v
    rows = len(before.time) - 1, len(after.time) - 1
    return replace(
        motion,
        time=np.concatenate([before.time[:-1], time, time[-1] + after.time[1:]]),
        q=np.vstack(
            [
                _with_base(before.q[:-1], motion.q[0, :base]),
                motion.q,
                _with_base(after.q[1:], motion.q[-1, :base]),
            ]
        ),
        v=np.vstack(
            [_with_base(before.v[:-1], np.zeros(v_base)), motion.v, _with_base(after.v[1:], np.zeros(v_base))]
        ),
        a=np.vstack(
            [_with_base(before.a[:-1], np.zeros(v_base)), motion.a, _with_base(after.a[1:], np.zeros(v_base))]
        ),
        contacts={name: np.pad(flags, rows, mode="edge") for name, flags in motion.contacts.items()},
    )


def _is_whole(robot: Robot, motion: Motion) -> bool:
    """Whether there is anything to lead to and from: what is broken, the check says."""
    shapes = motion.q.shape == (motion.n_samples, robot.model.nq) and motion.n_samples > 2
    return (
        shapes
        and motion.joint_names == robot.joint_names
        and bool(np.isfinite(motion.q).all() and (np.diff(motion.time) > 0.0).all())
    )


def _approach_way(robot: Robot, motion: Motion, row: int) -> _Way | None:
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
    rate = (motion.n_samples - 1) / motion.duration
    postures = find_route(robot, start, end, np.random.default_rng(_SEED)) or [start, end]
    ways = [_way_along(robot, postures, rate, speed) for speed in _SPEEDS]
    return next((way for way in ways if _is_safe_way(robot, motion, way)), ways[0])


def _way_along(robot: Robot, postures: list[Array], rate_hz: float, speed: float) -> _Way:
    """Straight from posture to posture, at rest in each, at a share of what a transfer does."""
    way = _Way(np.zeros(1), postures[0][None], *(np.zeros((1, robot.n_joints)) for _ in range(2)))
    for start, end in pairwise(postures):
        # Sampled more finely by as much as it is stretched afterwards.
        part = plan_transfer(robot, start, end, rate_hz / speed)
        way = _Way(
            np.concatenate([way.time, way.time[-1] + part.time[1:] / speed]),
            np.vstack([way.q, part.q[1:]]),
            np.vstack([way.v, speed * part.v[1:]]),
            np.vstack([way.a, speed**2 * part.a[1:]]),
        )
    return way


def _is_safe_way(robot: Robot, motion: Motion, way: _Way) -> bool:
    zero = np.zeros(robot.n_base_v)
    alone = replace(
        motion,
        time=way.time,
        q=_with_base(way.q, robot.rest[: robot.n_base_q]),
        v=_with_base(way.v, zero),
        a=_with_base(way.a, zero),
        contacts={},
        metadata=replace(motion.metadata, previous="", following="", stated_hash="", robot_hash=""),
        robot=robot.name,
    )
    return check_motion(robot, alone).safe


def _empty_way(robot: Robot) -> _Way:
    return _Way(np.zeros(1), *(np.zeros((1, robot.n_joints)) for _ in range(3)))


def _with_base(joints: Array, base: Array) -> Array:
    """Rows of joints behind the same base."""
    return np.hstack([np.tile(base, (len(joints), 1)), joints])
