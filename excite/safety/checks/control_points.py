"""What joints do between samples: Bézier control points, and the bounds that follow from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.motion.motion import Motion

# Intervals whose control points are looked at together: a megabyte of them stays in the processor's cache.
_BLOCK = 256


@dataclass(frozen=True, eq=False)
class JointBounds:
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


@dataclass(frozen=True, eq=False)
class ControlPoints:
    """Bézier control points of the joints' motion on intervals of a grid.

    Between samples a motion follows quintic polynomials; a polynomial never leaves the range of its control
    points (Farin 2002, section 4.3), so bounds on these hold at every instant, not only at samples.

    Attributes:
        position: ``(6, m, n_joints)`` [rad or m].
        velocity: ``(5, m, n_joints)`` [rad/s or m/s].
        acceleration: ``(4, m, n_joints)`` [rad/s² or m/s²].
    """

    position: Array
    velocity: Array
    acceleration: Array

    def bounds(self) -> JointBounds:
        """Bounds on the same intervals."""
        return JointBounds(
            self.position.min(axis=0),
            self.position.max(axis=0),
            np.abs(self.velocity).max(axis=0),
            np.abs(self.acceleration).max(axis=0),
        )


def control_points(motion: Motion, first: int, last: int) -> ControlPoints:
    """Control points of a motion's quintic interpolant on the intervals from its sample ``first`` to ``last``."""
    part = slice(first, last + 1)
    h = np.diff(motion.time[part])[:, None]
    q, v, a = (
        values[part]
        for values in (motion.joint_positions(), motion.joint_velocities(), motion.joint_accelerations())
    )
    step = np.diff(q, axis=0)
    offsets = np.stack(
        [
            np.zeros_like(step),
            h * v[:-1] / 5.0,
            2.0 * h * v[:-1] / 5.0 + h**2 * a[:-1] / 20.0,
            step - 2.0 * h * v[1:] / 5.0 + h**2 * a[1:] / 20.0,
            step - h * v[1:] / 5.0,
            step,
        ]
    )
    velocity = 5.0 * np.diff(offsets, axis=0) / h
    acceleration = 4.0 * np.diff(velocity, axis=0) / h
    return ControlPoints(q[:-1] + offsets, velocity, acceleration)


def joint_bounds(motion: Motion) -> JointBounds:
    """Bounds on all intervals of a motion's own grid."""
    last = motion.n_samples - 1
    parts = [
        control_points(motion, start, min(start + _BLOCK, last)).bounds() for start in range(0, last, _BLOCK)
    ]
    return JointBounds(
        np.concatenate([part.lowest for part in parts]),
        np.concatenate([part.highest for part in parts]),
        np.concatenate([part.speed for part in parts]),
        np.concatenate([part.acceleration for part in parts]),
    )
