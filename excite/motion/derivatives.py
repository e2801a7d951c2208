"""Velocities and accelerations of motions that state positions alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.errors import MotionError
from excite.motion.motion import Motion

# What a spline needs for its end conditions.
_LEAST_SAMPLES = 4


def with_derivatives(columns: Mapping[str, Array], joints: Sequence[str], path: Path) -> dict[str, Array]:
    """Columns of a motion with the velocities and accelerations of its joints that were not there.

    Of positions, those of the cubic spline through them whose third derivative does not jump at the second sample
    and the last but one: a start from rest with any constant acceleration is met exactly. Of stated velocities, the
    accelerations of the same spline through them. All joints state a quantity, or none does.

    Args:
        columns: ``(n,)`` each, ``time`` [s] and ``q.JOINT`` [rad or m] among them.
        joints: of the robot.
        path: the file, for errors.

    Raises:
        MotionError: some joints state velocities or accelerations and some do not, or there are too few samples.
    """
    found = dict(columns)
    for below, wanted in (("q", "v"), ("v", "a")):
        missing = [joint for joint in joints if f"{wanted}.{joint}" not in found]
        if not missing or any(f"{below}.{joint}" not in found for joint in joints):
            continue
        if len(missing) < len(joints):
            raise MotionError(
                "column is missing",
                source=path,
                field=f"{wanted}.{missing[0]}",
                remedy=f"state it for every joint, or for none and it is that of a spline through {below}",
            )
        if len(found["time"]) < _LEAST_SAMPLES:
            raise MotionError(
                f"has {len(found['time'])} samples", source=path, field="time", remedy="at least 4 are needed"
            )
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(found["time"], np.column_stack([found[f"{below}.{joint}"] for joint in joints]))
        rates = spline(found["time"], 1)
        found |= {f"{wanted}.{joint}": rates[:, i] for i, joint in enumerate(joints)}
        if wanted == "v" and not any(f"a.{joint}" in found for joint in joints):
            accelerations = spline(found["time"], 2)
            found |= {f"a.{joint}": accelerations[:, i] for i, joint in enumerate(joints)}
    return found


def thinned(motion: Motion, every: int) -> Motion:
    """Every so manieth sample of a motion and the last, accelerations those of the cubic spline through the joints'
    positions: rounding of positions makes third derivatives wrong by its size over the step's cube.
    """
    from scipy.interpolate import CubicSpline

    rows = np.r_[
        np.arange(0, motion.n_samples - 1, every)[: (motion.n_samples - 1) // every], motion.n_samples - 1
    ]
    time, a = motion.time[rows], motion.a[rows]
    a[:, motion.a.shape[1] - len(motion.joint_names) :] = CubicSpline(time, motion.joint_positions()[rows])(
        time, 2
    )
    return replace(motion, time=time, q=motion.q[rows], v=motion.v[rows], a=a)
