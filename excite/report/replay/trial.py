"""A trial of a record as a page's replay has it: the robot as it was measured, and a ghost beside it."""

from __future__ import annotations

from typing import Any

import numpy as np

from excite.arrays import Array
from excite.report.replay.packed import packed
from excite.report.replay.tracks import FRAMES_HZ, bounds
from excite.robot.robot import Robot


def trial_track(
    robot: Robot,
    name: str,
    time: Array,
    measured: Array,
    joints: tuple[str, ...],
    *,
    base: Array | None = None,
    ghost: tuple[str, Array] | None = None,
) -> dict[str, Any]:
    """What is to be seen of a trial, at :data:`~excite.report.replay.tracks.FRAMES_HZ`.

    Args:
        robot: the robot; joints that were not recorded rest.
        name: of the trial.
        time: ``(n,)`` [s], increasing.
        measured: positions, ``(n, n_joints)`` [rad or m].
        joints: of the columns.
        base: poses of a free base, ``(n, 7)``: x y z qx qy qz qw; None where they were not recorded.
        ghost: what the other robot is, and its positions, ``(n, n_joints)``.

    Returns:
        The content of :meth:`~excite.report.replay.tracks.Tracks.to_json` that a record tells.
    """
    frames = np.linspace(time[0], time[-1], max(2, round(float(time[-1] - time[0]) * FRAMES_HZ) + 1))
    shown = _at(frames, time, measured)
    here = np.tile(robot.rest, (len(frames), 1))
    if base is not None and robot.floating:
        here[:, :7] = base[np.searchsorted(time, frames).clip(0, len(time) - 1)]
    columns = [robot.n_base_q + robot.joint_index(joint) for joint in joints]
    here[:, columns] = shown
    signal: dict[str, Any] = {"title": "position", "unit": "rad", "from": robot.n_base_q, "label": "measured"}
    signal["limits"] = bounds(robot.limits.position_lower, robot.limits.position_upper)
    content: dict[str, Any] = {
        "name": name,
        "time": packed(frames - frames[0]),
        "q": packed(here),
        "label": "measured",
        "signals": [signal],
    }
    if ghost is not None:
        label, positions = ghost
        there = here.copy()
        there[:, columns] = _at(frames, time, positions)
        content["ghost"] = {"label": label, "q": packed(there)}
        signal |= {"other": packed(there[:, robot.n_base_q :]), "otherLabel": label}
    return content


def _at(frames: Array, time: Array, values: Array) -> Array:
    return np.column_stack([np.interp(frames, time, column) for column in values.T])

