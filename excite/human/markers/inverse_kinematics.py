"""Postures from markers: weighted least squares, frame by frame.

Every frame minimises ``Σ ρ(|p_m − x_m(q)|) + prior``, solved by damped Gauss-Newton steps on the segments'
rotations, so that no posture is singular. Markers that are missing have no term; the prior, so weak that markers
overrule it, holds what no marker says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.human.markers.posture_loops import fit_frames
from excite.human.posture.skeleton import N_SEGMENTS, Pose, neutral_pose, place_segments

_PRIOR = 2.0


@dataclass(frozen=True, eq=False)
class MarkerModel:
    """Markers on a body of known dimensions.

    Attributes:
        labels: ``m`` labels.
        segment: index of each marker's segment ``(m,)``.
        local: place in the segment's frame ``(m, 3)`` [m].
        offsets: joints in their parents' frames ``(15, 3)`` [m].
    """

    labels: tuple[str, ...]
    segment: NDArray[np.int64]
    local: Array
    offsets: Array

    def predicted(self, pose: Pose) -> Array:
        """World positions of the markers, ``(n, m, 3)`` [m]."""
        return place_segments(pose, self.offsets).points(self.segment, self.local)


@dataclass(frozen=True, eq=False)
class Solution:
    """Postures and what they leave.

    Attributes:
        pose: postures of all frames.
        residual: distance of each marker from its predicted place ``(n, m)`` [m], NaN where it is missing.
        cost: of each frame ``(n,)``.
    """

    pose: Pose
    residual: Array
    cost: Array


def solve_poses(
    model: MarkerModel,
    points: Array,
    start: Pose,
    *,
    steps: int = 12,
    robust: bool = True,
    prior: Pose | None = None,
    prior_weight: Array | None = None,
) -> Solution:
    """Find the postures that fit markers best.

    Args:
        model: the markers.
        points: measured positions ``(n, m, 3)`` [m], NaN where a marker is missing.
        start: first guess, ``n`` frames.
        steps: most iterations.
        robust: whether far markers count less.
        prior: postures that the prior pulls to; standing if None.
        prior_weight: ``(n, 15)`` one over the prior's standard deviation of each joint [1/rad]; weak if None.

    Returns:
        The solution.
    """
    # One layout of every array, or numba compiles again.
    contiguous = np.ascontiguousarray
    n, seen = len(points), contiguous(np.isfinite(points).all(axis=2))
    pose = Pose(np.array(start.position, order="C"), np.array(start.rotation, order="C"))
    weight = np.full((n, N_SEGMENTS), 1.0 / _PRIOR) if prior_weight is None else prior_weight
    distance, cost = np.empty(seen.shape), np.empty(n)
    fit_frames(
        contiguous(np.where(seen[:, :, None], points, 0.0)),
        seen,
        pose.position,
        pose.rotation,
        contiguous((neutral_pose() if prior is None else prior).rotation),
        contiguous(weight),
        contiguous(model.offsets),
        contiguous(model.segment),
        contiguous(model.local),
        steps,
        robust,
        distance,
        cost,
    )
    return Solution(pose, np.where(seen, distance, np.nan), cost)
