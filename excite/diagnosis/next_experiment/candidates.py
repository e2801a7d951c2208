"""Motions to choose the next experiment from: the record's paths, and the generators' through the safety filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.next_experiment.paths import accelerations, retraced
from excite.errors import RobotError
from excite.motion.generators.candidate import Candidate
from excite.motion.generators.mixture import plan_candidates
from excite.motion.motion import Motion, MotionMetadata
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_shapes
from excite.safety.check import check_motion
from excite.safety.checks.collision import SelfCollisionCheck
from excite.safety.checks.registry import CHECKS
from excite.safety.checks.sweep import Sweep
from excite.safety.filter import filter_candidate

_PATHS = 1
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

    def safe(self) -> Motion | None:
        """The motion as it may be run; None where it breaks a limit or collides.

        Collisions of a model without shapes cannot be judged: its limits are.
        """
        if self.candidate is not None:
            return filter_candidate(self.robot, self.candidate).motion
        if has_shapes(self.robot):
            return self.sketch if check_motion(self.robot, self.sketch).safe else None
        sweep = Sweep(self.robot, self.sketch, None)
        judged = (check().judge(sweep) for check in CHECKS.values() if check is not SelfCollisionCheck)
        return None if any(result.violations for result in judged) else self.sketch


def has_shapes(robot: Robot) -> bool:
    """Whether collisions can be judged."""
    try:
        collision_shapes(robot)
    except RobotError:
        return False
    return True


def touching(samples: ArmSamples) -> tuple[str, ...]:
    """Pairs of links, ``A and B``, whose shapes are closer than allowed in postures that the record has been through.

    Such shapes are too large, or the pair cannot touch: no motion of this robot would be judged safe.
    """
    robot = samples.robot
    if not has_shapes(robot):
        return ()
    link = {shape.name: shape.link for shape in collision_shapes(robot)}
    judged = SelfCollisionCheck().judge(Sweep(robot, retraced(samples, _PATHS)[0], None))
    pairs = [v.where.split(" - ") for v in judged.violations if v.kind == SelfCollisionCheck.name]
    return tuple(dict.fromkeys(" and ".join(link.get(name, name) for name in pair) for pair in pairs))


def near(samples: ArmSamples, targets: Sequence[str], seed: int) -> list[Offer]:
    """Motions within what the record has shown; without shapes, along its own paths alone.

    Args:
        samples: the samples.
        targets: joints to aim at.
        seed: of the generators.
    """
    again = [Offer(motion, samples.robot) for motion in retraced(samples, _PATHS)]
    if not has_shapes(samples.robot):
        return again
    inside = within_record(samples)
    return [*again, *(Offer(sketch(inside, c), inside, c) for c in _drawn(inside, targets, seed))]


def beyond(samples: ArmSamples, targets: Sequence[str], seed: int) -> list[Offer]:
    """Motions through postures that the record has not been through, same arguments.

    Over the model's whole range where it has shapes to judge collisions by; else each joint stays between the
    positions that it has been at.
    """
    if has_shapes(samples.robot):
        robot = samples.robot
        return [Offer(sketch(robot, c), robot, c, _ELSEWHERE) for c in _drawn(robot, targets, seed + 1)]
    inside = within_record(samples, 0.0)
    return [
        Offer(sketch(inside, c), samples.robot, None, _UNJUDGED) for c in _drawn(inside, targets, seed + 1)
    ]


def _drawn(robot: Robot, targets: Sequence[str], seed: int) -> list[Candidate]:
    return plan_candidates(robot, _DRAWN, np.random.SeedSequence(seed), targets=targets)


def sketch(robot: Robot, candidate: Candidate) -> Motion:
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


def joined_motions(first: Motion, second: Motion) -> Motion:
    """One motion and then another that begins where it ends."""
    time = second.time[1:] - second.time[0] + first.time[-1]
    q, v, a = (
        np.vstack([x, y[1:]]) for x, y in ((first.q, second.q), (first.v, second.v), (first.a, second.a))
    )
    return replace(first, time=np.concatenate([first.time, time]), q=q, v=v, a=a)


def within_record(samples: ArmSamples, more: float = 0.2) -> Robot:
    """The robot with limits of what the record has shown, ``more`` of it in range, a fifth more of speed."""
    robot, index = samples.robot, list(samples.index)
    fastest = np.abs(samples.stacked("v")[:, index]).max(axis=0)
    q = samples.stacked("q")[:, index]
    limits = robot.limits
    middle, half = 0.5 * (q.max(axis=0) + q.min(axis=0)), 0.5 * (1.0 + more) * np.ptp(q, axis=0)
    lower, upper = limits.position_lower.copy(), limits.position_upper.copy()
    lower[index] = np.maximum(lower[index], middle - half)
    upper[index] = np.minimum(upper[index], middle + half)
    velocity, acceleration = limits.velocity.copy(), limits.acceleration.copy()
    velocity[index] = np.minimum(velocity[index], 1.2 * fastest)
    acceleration[index] = np.minimum(acceleration[index], accelerations(samples, 1.2))
    rest = robot.rest.copy()
    rest[index] = middle
    narrow = replace(
        limits, position_lower=lower, position_upper=upper, velocity=velocity, acceleration=acceleration
    )
    return replace(robot, limits=narrow, rest=rest)
