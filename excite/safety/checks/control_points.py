"""What joints do between samples: bounds from Bézier control points.

Between samples a motion follows quintic polynomials; a polynomial never leaves the range of its control points (Farin
2002, section 4.3), so bounds on these hold at every instant, not only at samples.
"""

from __future__ import annotations

from functools import reduce
from itertools import accumulate, pairwise
from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.motion.motion import Motion

# Intervals whose control points are looked at together: a megabyte of them stays in the processor's cache.
_BLOCK = 256


class JointBounds(NamedTuple):
    """What joints do not pass on each interval of a grid, at any instant.

    Attributes:
        lowest: ``(n-1, n_joints)`` position [rad or m].
        highest: ``(n-1, n_joints)`` position [rad or m].
        speed: ``(n-1, n_joints)`` magnitude of the velocity [rad/s or m/s].
        acceleration: ``(n-1, n_joints)`` magnitude of the acceleration [rad/s² or m/s²].
    """

    lowest: Array
    highest: Array
    speed: Array
    acceleration: Array


def joint_bounds(motion: Motion) -> JointBounds:
    """Bounds on all intervals of a motion's own grid."""
    time, n = motion.time, motion.n_samples - 1
    samples = motion.joint_positions(), motion.joint_velocities(), motion.joint_accelerations()
    found = np.empty((4, n, samples[0].shape[1]))
    for start in range(0, n, _BLOCK):
        part = slice(start, min(start + _BLOCK, n) + 1)
        q, v, a = (values[part] for values in samples)
        found[:, start : start + _BLOCK] = _bound_between_samples(np.diff(time[part])[:, None], q, v, a)
    return JointBounds(*found)


def jerk_bounds(motion: Motion) -> Array:
    """What the magnitude of each joint's jerk does not pass on each interval, ``(n-1, n_joints)`` [rad/s³ or m/s³].

    Jerk is a parabola there, whose three control points are third differences of the position's six. Positions that
    are rounded by δ make it wrong by up to 120 δ over the interval's cube: of use where samples are not dense.
    """
    h = np.diff(motion.time)[:, None]
    q, v, a = motion.joint_positions(), motion.joint_velocities() / 5.0, motion.joint_accelerations() / 20.0
    slopes = _slopes(h, np.diff(q, axis=0), v, a)
    bends = [after - before for before, after in pairwise(slopes)]
    peaks = reduce(np.maximum, [np.abs(after - before) for before, after in pairwise(bends)])
    return np.asarray(60.0 * peaks / (h * h * h))


def _bound_between_samples(h: Array, q: Array, v: Array, a: Array) -> JointBounds:
    """Bounds between samples ``(m + 1, n_joints)`` that are ``h`` ``(m, 1)`` apart, each ``(m, n_joints)``."""
    velocity = _slopes(h, np.diff(q, axis=0), v / 5.0, a / 20.0)
    position = list(accumulate(velocity, initial=np.zeros_like(velocity[0])))
    # Element by element: of stacks of the points the bounds of a G1's motion take 7.7 ms in place of 3.4.
    lowest, highest = reduce(np.minimum, position), reduce(np.maximum, position)
    fastest = reduce(np.maximum, [np.abs(point) for point in velocity])
    hardest = reduce(np.maximum, [np.abs(after - before) for before, after in pairwise(velocity)])
    return JointBounds(q[:-1] + lowest, q[:-1] + highest, 5.0 * fastest / h, 20.0 * hardest / (h * h))


def _slopes(h: Array, step: Array, v: Array, a: Array) -> tuple[Array, ...]:
    """Differences of the position's six control points; ``v`` is a fifth of the velocity, ``a`` a twentieth of the
    acceleration.

    Control points of derivatives are the differences of those before, times the degree over the interval.
    """
    first, last = h * v[:-1], step - h * v[1:]
    second, third = 2.0 * first + h * h * a[:-1], last - h * v[1:] + h * h * a[1:]
    return first, second - first, third - second, last - third, step - last
