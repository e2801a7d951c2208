"""Postures without a first guess."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.human.markers.inverse_kinematics import MarkerModel, Solution, solve_poses
from excite.human.posture.skeleton import COLUMNS, N_SEGMENTS, neutral_pose, place_segments
from excite.human.segments import NAMES, PARENTS

_FEWEST_MARKERS = 3
_SPHERICAL = tuple(k for k in range(1, N_SEGMENTS) if COLUMNS[k].stop - COLUMNS[k].start == 3)


def first_poses(model: MarkerModel, points: Array) -> Solution:
    """Postures without a first guess: the pelvis by its own markers, then outwards, then all together.

    Args:
        model: the markers; those without a known place (NaN) are left out.
        points: ``(n, m, 3)`` [m].
    """
    known = np.isfinite(model.local).all(axis=1)
    part = replace(
        model,
        labels=tuple(np.array(model.labels)[known]),
        segment=model.segment[known],
        local=model.local[known],
    )
    shown = points[:, known]
    start = neutral_pose(len(points))
    rotation, origin = align_segment(part, shown, "pelvis")
    start.rotation[:, 0], start.position[:] = rotation, origin
    for name in NAMES[1:]:
        k = NAMES.index(name)
        if k in _SPHERICAL and (part.segment == k).sum() >= _FEWEST_MARKERS:
            world, _ = align_segment(part, shown, name)
            carrier = place_segments(start, model.offsets).rotation[:, PARENTS[k]]
            start.rotation[:, k] = carrier.transpose(0, 2, 1) @ world
    rough = solve_poses(part, shown, start, steps=40, robust=False)
    return solve_poses(part, shown, rough.pose, steps=10)


def align_segment(model: MarkerModel, points: Array, segment: str) -> tuple[Array, Array]:
    """Rotation ``(n, 3, 3)`` and origin ``(n, 3)`` of a segment by its own markers alone (Kabsch 1976).

    Frames that show fewer than three of them get an upright segment at the mean of what is seen.
    """
    own = np.flatnonzero(model.segment == NAMES.index(segment))
    target, local = points[:, own], model.local[own]
    seen = np.asarray(np.isfinite(target).all(axis=2))
    count = np.maximum(seen.sum(axis=1), 1)
    target = np.where(seen[:, :, None], target, 0.0)
    middle = target.sum(axis=1) / count[:, None]
    own_middle = (seen[:, :, None] * local).sum(axis=1) / count[:, None]
    a = (local[None] - own_middle[:, None]) * seen[:, :, None]
    b = (target - middle[:, None]) * seen[:, :, None]
    u, _, vt = np.linalg.svd(a.transpose(0, 2, 1) @ b)
    sign = np.sign(np.linalg.det(u @ vt))
    flip = np.tile(np.eye(3), (len(points), 1, 1))
    flip[:, 2, 2] = np.where(sign == 0.0, 1.0, sign)
    rotation = vt.transpose(0, 2, 1) @ flip @ u.transpose(0, 2, 1)
    rotation[seen.sum(axis=1) < _FEWEST_MARKERS] = np.eye(3)
    origin = middle - np.einsum("nij,nj->ni", rotation, own_middle)
    return rotation, origin
