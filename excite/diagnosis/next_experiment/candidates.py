"""Motions to choose the next experiment from: the record's paths, and the generators' through the safety filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import ArmTrial
from excite.diagnosis.equations.samples import ArmSamples
from excite.errors import RobotError
from excite.logs.signals.butterworth import central_differences, lowpass
from excite.motion.generators.generator import Candidate
from excite.motion.generators.mixture import plan_candidates
from excite.motion.motion import Motion, MotionMetadata
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_shapes
from excite.safety.check import CHECKS, check_motion
from excite.safety.checks.sweep import Sweep
from excite.safety.filter import filter_candidate

_DRAWN = 10
_SKETCH_HZ = 50.0
# Share of limits that a sketch uses all the way; the filter's time law uses more where it can.
_USED = 0.7
_ELSEWHERE = "it leaves the positions of this record: look at the robot's surroundings first"
_UNJUDGED = (
    "its postures are new and the model has no shapes to judge collisions by: look at it in a simulator first"
)


@dataclass(frozen=True, eq=False)
class Offer:
    """A motion to be had.

    Attributes:
        sketch: what it will be like.
        robot: the robot, with the limits that it keeps.
        candidate: what the safety filter makes the motion of; None where the sketch is the motion.
        caution: what a person has to look at before it is run; empty where all is judged or has been done.
    """

    sketch: Motion
    robot: Robot
    candidate: Candidate | None = None
    caution: str = ""

    def make_safe(self) -> Motion | None:
        """The motion as it may be run; None where it breaks a limit or collides.

        Collisions of a model without shapes cannot be judged: its limits are.
        """
        if self.candidate is not None:
            return filter_candidate(self.robot, self.candidate).motion
        if has_shapes(self.robot):
            return self.sketch if check_motion(self.robot, self.sketch).safe else None
        sweep = Sweep(self.robot, self.sketch, None)
        judged = (check().judge(sweep) for name, check in CHECKS.items() if name != "self_collision")
        return None if any(result.violations for result in judged) else self.sketch


def has_shapes(robot: Robot) -> bool:
    """Whether collisions can be judged."""
    try:
        collision_shapes(robot)
    except RobotError:
        return False
    return True


def draw_motions(samples: ArmSamples, targets: Sequence[str], seed: int, *, wide: bool) -> list[Offer]:
    """Motions within what the record has shown, or, wide ones, through postures that it has not been through.

    Within it are the record's own paths and, with shapes to judge collisions by, the generators' motions. Wide ones
    have the model's whole range; without shapes each joint stays between the positions that it has been at.

    Args:
        targets: joints to aim at.
        seed: of the generators.
        wide: whether postures may be new.
    """
    robot, shapes = samples.robot, has_shapes(samples.robot)
    made = [] if wide else [Offer(motion, robot) for motion in retrace_record(samples)]
    if not wide and not shapes:
        return made
    limits = robot if wide and shapes else limit_to_record(samples, 0.2 if shapes else 0.0)
    for drawn in plan_candidates(limits, _DRAWN, np.random.SeedSequence(seed + wide), targets=targets):
        path = sketch_motion(limits, drawn)
        if shapes:
            made.append(Offer(path, limits, drawn, _ELSEWHERE if wide else ""))
        else:
            made.append(Offer(path, robot, None, _UNJUDGED))
    return made


def sketch_motion(robot: Robot, candidate: Candidate) -> Motion:
    """A candidate's path at the constant rate that the limits allow, before the filter has made it safe."""
    curve = candidate.posture
    s = np.linspace(0.0, curve.length, 200)
    first, second = np.abs(curve.evaluate(s, 1)), np.abs(curve.evaluate(s, 2))
    fastest = _USED * robot.limits.velocity / np.maximum(first, 1e-9)
    hardest = np.sqrt(_USED * robot.limits.acceleration / np.maximum(second, 1e-9))
    rate = float(min(fastest.min(), hardest.min()))
    if candidate.speed is not None:
        rate = min(rate, candidate.speed)
    n = max(round(curve.length / rate * _SKETCH_HZ), 50)
    time = np.arange(n + 1) / _SKETCH_HZ
    along = np.linspace(0.0, curve.length, n + 1)
    return Motion(
        name=candidate.name,
        robot=robot.name,
        joint_names=robot.joint_names,
        time=time,
        q=curve.evaluate(along),
        v=rate * curve.evaluate(along, 1),
        a=rate**2 * curve.evaluate(along, 2),
        metadata=MotionMetadata(
            generator=candidate.generator, targets=candidate.targets, robot_hash=robot.hash
        ),
    )


def limit_to_record(samples: ArmSamples, more: float = 0.2) -> Robot:
    """The robot with limits of what the record has shown, ``more`` of it in range, a fifth more of speed."""
    robot, index = samples.robot, list(samples.index)
    fastest = np.abs(samples.stack_trials("v")[:, index]).max(axis=0)
    q = samples.stack_trials("q")[:, index]
    limits = robot.limits
    middle, half = 0.5 * (q.max(axis=0) + q.min(axis=0)), 0.5 * (1.0 + more) * np.ptp(q, axis=0)
    lower, upper = limits.position_lower.copy(), limits.position_upper.copy()
    lower[index] = np.maximum(lower[index], middle - half)
    upper[index] = np.minimum(upper[index], middle + half)
    velocity, acceleration = limits.velocity.copy(), limits.acceleration.copy()
    velocity[index] = np.minimum(velocity[index], 1.2 * fastest)
    acceleration[index] = np.minimum(acceleration[index], allowed_accelerations(samples, 1.2))
    rest = robot.rest.copy()
    rest[index] = middle
    narrow = replace(
        limits, position_lower=lower, position_upper=upper, velocity=velocity, acceleration=acceleration
    )
    return replace(robot, limits=narrow, rest=rest)


# Motions on postures that a record has been through: other speeds along its paths, where shapes are not
# known.

GENERATOR = "retraced"
LONGEST_S = 30.0
_SPEEDS = (0.25, 0.6, 1.2)
_CHIRP_HZ = ((0.3, 3.0), (0.3, 8.0))
_SMOOTH_HZ = 8.0
# Beyond what the record has shown: speed, and acceleration, which a chirp needs more of, where a limit is known.
_FASTER, _HARDER = 1.25, 3.0
# Acceleration that a model has which states none [rad/s²].
_NO_LIMIT = 1000.0
# Share of a limit, or of what the record has shown but for its noisiest samples.
_WITHIN, _SHOWN = 0.95, 0.999


def retrace_record(samples: ArmSamples) -> list[Motion]:
    """Motions along the path of the record's first trial, in joint space.

    Each runs it slower, faster, or to and fro about one of its points in a chirp, its amplitude shrinking
    as frequency grows. No posture is new, so that nothing can be hit that the record has not hit; speeds stay
    within 1.25 times the record's and the model's limits, accelerations within three times the record's where the
    model limits them, else within the record's.
    """
    trial = next(t for t in samples.trials if t.identification and t.repeats is None)
    rate, end = samples.rate_hz, float(trial.time[-1])
    made = []
    for speed in _SPEEDS:
        t = np.arange(round(min(end / speed, LONGEST_S) * rate)) / rate
        way = speed * _ease_ends(t, 0.5)
        along = np.concatenate([[0.0], np.cumsum(0.5 * (way[1:] + way[:-1])) / rate])
        made.append(_make_motion(samples, trial, along, f"speed_{speed:g}"))
    index = list(samples.index)
    fastest = ((trial.v[:, index] / _largest_magnitude(samples, "v")) ** 2).sum(axis=1)
    inner = slice(round(rate), -round(rate))
    middle = float(trial.time[inner][int(np.argmax(fastest[inner]))])
    room = 0.9 * min(middle, end - middle, 1.0)
    t = np.arange(round(min(LONGEST_S, 20.0) * rate)) / rate
    for low, high in _CHIRP_HZ:
        growth = np.log(high / low) / t[-1]
        frequency = low * np.exp(growth * t)
        # Path speed of at most the record's, and path acceleration as the chirp's own limit leaves it.
        amplitude = np.minimum(room, 1.0 / (2.0 * np.pi * frequency)) * _ease_ends(t, 1.0)
        along = middle + amplitude * np.sin(2.0 * np.pi * (frequency - low) / growth)
        made.append(_make_motion(samples, trial, along, f"chirp_{high:g}_hz"))
    return made


def _ease_ends(t: Array, seconds: float) -> Array:
    """From 0 to 1 and back within some seconds of both ends."""
    rise = np.minimum(np.minimum(t, t[-1] - t) / seconds, 1.0)
    return np.asarray(rise**2 * (3.0 - 2.0 * rise))


def allowed_accelerations(samples: ArmSamples, harder: float) -> Array:
    """Largest accelerations that a new motion may have ``(n_joints,)`` [rad/s²].

    ``harder`` times the record's, within the model's limits; where the model states none, the record's own.
    """
    shown = np.quantile(np.abs(samples.stack_trials("a")[:, list(samples.index)]), _SHOWN, axis=0)
    limit = samples.robot.limits.acceleration[list(samples.index)]
    return _WITHIN * np.where(limit < _NO_LIMIT, np.minimum(harder * shown, limit), shown)


def _largest_magnitude(samples: ArmSamples, name: str) -> Array:
    return np.maximum(np.abs(samples.stack_trials(name)[:, list(samples.index)]).max(axis=0), 1e-6)


def _make_motion(samples: ArmSamples, trial: ArmTrial, along: Array, name: str) -> Motion:
    """The path at these times, slowed down as a whole until it is within the limits."""
    robot, index, rate = samples.robot, list(samples.index), samples.rate_hz
    path = lowpass(trial.q, rate, min(_SMOOTH_HZ, 0.2 * rate))
    most_v = np.minimum(_FASTER * _largest_magnitude(samples, "v"), robot.limits.velocity[index])
    most_a = allowed_accelerations(samples, _HARDER)
    slower = 1.0
    for _ in range(8):
        n = round(len(along) * slower)
        s = np.interp(np.linspace(0.0, len(along) - 1.0, n), np.arange(len(along)), along)
        q = np.column_stack([np.interp(s, trial.time, column) for column in path.T])
        d = central_differences(lowpass(q, rate, min(1.5 * _SMOOTH_HZ, 0.25 * rate)), rate)
        excess = max(
            float((np.abs(d.first[:, index]).max(axis=0) / most_v).max()),
            float(np.sqrt((np.abs(d.second[:, index]).max(axis=0) / most_a).max())),
        )
        if excess <= 1.0:
            break
        slower *= 1.02 * excess
    return Motion(
        name=f"{trial.name}_{name}",
        robot=robot.name,
        joint_names=robot.joint_names,
        time=np.arange(len(q)) / rate,
        q=d.value,
        v=d.first,
        a=d.second,
        metadata=MotionMetadata(generator=GENERATOR, targets=samples.joints, robot_hash=robot.hash),
    )


# Whether any motion at all would tell rivals apart: one through the whole range, whether or not it is safe.

# Sines of each joint [Hz], all others' a little faster: the rows' filter passes them.
_TURNS_HZ, _APART = (0.11, 0.27, 0.61, 1.3), 0.13
_RATE_HZ = 100.0


def full_range_sines(samples: ArmSamples) -> Motion:
    """Sines of all joints over their whole range, as fast as their limits of speed allow."""
    robot = samples.robot
    limits, t = robot.limits, np.arange(round(LONGEST_S * _RATE_HZ)) / _RATE_HZ
    low, high = np.maximum(limits.position_lower, -np.pi), np.minimum(limits.position_upper, np.pi)
    q, v, a = np.zeros((3, len(t), robot.n_joints))
    for j in range(robot.n_joints):
        turning = 2.0 * np.pi * np.array(_TURNS_HZ) * (1.0 + _APART * j)
        size = np.minimum(0.5 * (high[j] - low[j]), limits.velocity[j] / turning) / len(turning)
        # Golden angles: no two joints swing together.
        phase = np.outer(t, turning) + 2.4 * np.arange(len(turning)) + 2.4 * j
        q[:, j] = 0.5 * (low[j] + high[j]) + np.sin(phase) @ size
        v[:, j] = np.cos(phase) @ (size * turning)
        a[:, j] = -np.sin(phase) @ (size * turning**2)
    metadata = MotionMetadata(generator="everything", targets=samples.joints, robot_hash=robot.hash)
    return Motion("everything", robot.name, robot.joint_names, t, q, v, a, metadata=metadata)
