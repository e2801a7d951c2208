"""Roll-outs of a standing robot's base put back where they lie in a trial, for a picture in motion."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.diagnosis.answer.rollout_path import RolloutPath
from excite.diagnosis.floating.equations.record import FloatingRecord
from excite.logs.columns import BASE_POSE


def base_path(record: FloatingRecord, windows: Sequence[slice], before: Array, after: Array) -> RolloutPath:
    """The trial of which most was simulated: its base's poses and its joints.

    Args:
        record: the trials.
        windows: samples of the roll-outs.
        before: where the base ends up less where it was, ``(n_windows, n_samples, 6)`` [m, rad], of the nominal
            simulator, turns in the base's frame.
        after: of the one with the effects, likewise.
    """
    inside = [_trial_of(record, window) for window in windows]
    trial = Counter(inside).most_common(1)[0][0]
    span = record.spans[trial]
    recorded = record.q[span]
    paths = [recorded.copy(), recorded.copy()]
    for where, window, *both in zip(inside, windows, before, after, strict=True):
        if where != trial:
            continue
        first = window.start - span.start
        for path, error in zip(paths, both, strict=True):
            # Of two windows that meet, the last sample is the first one's, which strayed for longest.
            for k, moved in enumerate(error[1:], start=first + 1):
                if k < len(path):
                    path[k, :7] = _moved(recorded[k, :7], moved)
    names = (*BASE_POSE, *record.robot.joint_names)
    columns = [
        *range(7),
        *(record.robot.n_base_q + record.robot.joint_index(n) for n in record.robot.joint_names),
    ]
    time = np.arange(len(recorded)) / record.rate_hz
    return RolloutPath(
        record.trials[trial], names, time, recorded[:, columns], *(path[:, columns] for path in paths)
    )


def _trial_of(record: FloatingRecord, window: slice) -> int:
    return next(k for k, span in enumerate(record.spans) if span.start <= window.start < span.stop)


def _moved(pose: Array, error: Array) -> Array:
    """A pose, x y z qx qy qz qw, displaced in the world and turned in its own frame."""
    x, y, z, w = pose[3:]
    turned = pin.Quaternion(pin.Quaternion(w, x, y, z).matrix() @ pin.exp3(error[3:]))
    return np.concatenate([pose[:3] + error[:3], [turned.x, turned.y, turned.z, turned.w]])
