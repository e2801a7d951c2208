"""Bézier control points of a motion between its samples, all at once and by their definition."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.motion.motion import Motion
from excite.safety.checks.control_points import JointBounds


@dataclass(frozen=True, eq=False)
class ControlPoints:
    """Of joints on intervals of a grid: position ``(6, m, n_joints)``, velocity ``(5, …)``, acceleration ``(4, …)``."""

    position: Array
    velocity: Array
    acceleration: Array

    def bounds(self) -> JointBounds:
        """The range of the points."""
        return JointBounds(
            self.position.min(axis=0),
            self.position.max(axis=0),
            np.abs(self.velocity).max(axis=0),
            np.abs(self.acceleration).max(axis=0),
        )


def control_points(motion: Motion) -> ControlPoints:
    """Those of the quintic that has a motion's positions, velocities and accelerations at both ends of an interval."""
    h = np.diff(motion.time)[:, None]
    q, v, a = motion.joint_positions(), motion.joint_velocities(), motion.joint_accelerations()
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
    return ControlPoints(q[:-1] + offsets, velocity, 4.0 * np.diff(velocity, axis=0) / h)
