"""Whether any motion at all would tell rivals apart: one through the whole range, whether or not it is safe."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from excite.arrays import Array
from excite.diagnosis.attribution.attribution import Scored
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.next_experiment.evidence import LONGEST_S, Expectation
from excite.motion.motion import Motion, MotionMetadata

# Sines of each joint [Hz], all others' a little faster: the rows' filter passes them.
_TURNS_HZ, _APART = (0.11, 0.27, 0.61, 1.3), 0.13
_RATE_HZ = 100.0
# Expected log-likelihood ratio, in units of what ties a pair, that is none. A body on a SCARA's second axis and a rotor
# on its first have 0.03, by the little that the body takes up elsewhere; a spring and an eccentric of a Panda's first
# joint, which other motions tell apart, have 1.3.
_NOTHING = 0.1


def alike_in_any(baseline: Baseline, rivals: Sequence[Scored], floor: Array) -> tuple[bool, ...]:
    """By rival after the first, whether no motion would tell it from the first.

    Args:
        baseline: the baseline before the first effect.
        rivals: hypotheses that the record cannot tell apart, the accepted one first.
        floor: ``(n_joints,)`` noise in the rows' band [N·m].
    """
    expectation = Expectation(baseline, rivals, floor)
    ratios = expectation.ratios(expectation.information(through_everything(baseline.samples)))
    either = np.maximum(ratios[0, 1:], ratios[1:, 0])
    return tuple(bool(ratio < _NOTHING) for ratio in either)


def through_everything(samples: ArmSamples) -> Motion:
    """Sines of all joints over their whole range, as fast as their limits of speed allow."""
    robot = samples.robot
    limits, n = robot.limits, robot.n_joints
    low, high = np.maximum(limits.position_lower, -np.pi), np.minimum(limits.position_upper, np.pi)
    t = np.arange(round(LONGEST_S * _RATE_HZ)) / _RATE_HZ
    q, v, a = (np.zeros((len(t), n)) for _ in range(3))
    for j in range(n):
        turning = 2.0 * np.pi * np.array(_TURNS_HZ) * (1.0 + _APART * j)
        size = np.minimum(0.5 * (high[j] - low[j]), limits.velocity[j] / turning) / len(turning)
        # Golden angles: no two joints swing together.
        phase = np.outer(t, turning) + 2.4 * np.arange(len(turning)) + 2.4 * j
        q[:, j] = 0.5 * (low[j] + high[j]) + np.sin(phase) @ size
        v[:, j] = np.cos(phase) @ (size * turning)
        a[:, j] = -np.sin(phase) @ (size * turning**2)
    metadata = MotionMetadata(generator="everything", targets=samples.joints, robot_hash=robot.hash)
    return Motion("everything", robot.name, robot.joint_names, t, q, v, a, metadata=metadata)
