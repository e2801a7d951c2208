"""Postures from markers: weighted least squares over all frames at once.

Every frame minimises ``Σ ρ(|p_m − x_m(q)|) + prior``, solved by damped Gauss-Newton steps on the segments'
rotations, so that no posture is singular. Markers that are missing have no term; the prior, so weak that markers
overrule it, holds what no marker says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.human.skeleton import (
    COLUMNS,
    N_SEGMENTS,
    N_VELOCITY,
    REVOLUTE_AXIS,
    Pose,
    logarithm,
    place,
    point_jacobian,
)
from excite.robot.robot import Array

_BLOCK = 512
# Markers count fully up to this distance [m] and less beyond (Geman-McClure), so that a swapped one is let go.
_CORE = 0.03
_SIGMA = 0.01
_PRIOR = 2.0
_CONVERGED = 1e-6
# Elbows and knees bend one way only; beyond a little overextension a stiff spring keeps them from folding over.
_HINGE_LEAST, _HINGE_SPRING = -0.15, 20.0


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
        return place(pose, self.offsets).points(self.segment, self.local)


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
    parts = [
        _solve_block(
            model,
            points[i : i + _BLOCK],
            start[i : i + _BLOCK].copy(),
            steps,
            robust,
            None if prior is None else prior[i : i + _BLOCK],
            None if prior_weight is None else prior_weight[i : i + _BLOCK],
        )
        for i in range(0, len(points), _BLOCK)
    ]
    return Solution(
        Pose(
            np.concatenate([part.pose.position for part in parts]),
            np.concatenate([part.pose.rotation for part in parts]),
        ),
        np.concatenate([part.residual for part in parts]),
        np.concatenate([part.cost for part in parts]),
    )


def _solve_block(
    model: MarkerModel,
    points: Array,
    pose: Pose,
    steps: int,
    robust: bool,
    prior: Pose | None,
    prior_weight: Array | None,
) -> Solution:
    seen = np.asarray(np.isfinite(points).all(axis=2))
    target = np.where(seen[:, :, None], points, 0.0)
    n = len(points)
    weight = np.full((n, N_SEGMENTS), 1.0 / _PRIOR) if prior_weight is None else prior_weight
    damping = np.full(n, 1e-3)
    active = np.arange(n)
    cost, distance = _cost(model, target, seen, pose, robust, prior, weight)
    for _ in range(steps):
        here = pose[active]
        placed = place(here, model.offsets)
        predicted = placed.points(model.segment, model.local)
        jacobian = point_jacobian(placed, predicted, model.segment)
        error = target[active] - predicted
        scale = np.where(seen[active], 1.0, 0.0) / _SIGMA
        if robust:
            scale = scale / (1.0 + (distance[active] / _CORE) ** 2)
        matrix = (jacobian * scale[:, :, None, None]).reshape(len(active), -1, N_VELOCITY)
        right = (error * scale[:, :, None]).reshape(len(active), -1)
        normal = matrix.transpose(0, 2, 1) @ matrix
        gradient = np.einsum("nij,ni->nj", matrix, right)
        pulls, strength = _prior_terms(here, None if prior is None else prior[active], weight[active])
        diagonal = np.arange(N_VELOCITY)
        normal[:, diagonal, diagonal] += strength + 1e-9
        gradient += pulls
        damped = normal.copy()
        damped[:, diagonal, diagonal] *= 1.0 + damping[active, None]
        step = np.linalg.solve(damped, gradient[:, :, None])[:, :, 0]
        # A step of more than half a radian leaves the region in which the linearisation means anything.
        largest = np.abs(step[:, 3:]).max(axis=1)
        step *= np.minimum(1.0, 0.5 / np.maximum(largest, 1e-12))[:, None]
        trial = here.moved(step)
        chosen = None if prior is None else prior[active]
        new_cost, new_distance = _cost(
            model, target[active], seen[active], trial, robust, chosen, weight[active]
        )
        better = new_cost <= cost[active] * (1.0 + 1e-12)
        gain = active[better]
        relative = (cost[gain] - new_cost[better]) / np.maximum(cost[gain], 1e-12)
        pose.position[gain], pose.rotation[gain] = trial.position[better], trial.rotation[better]
        cost[gain], distance[gain] = new_cost[better], new_distance[better]
        damping[gain] = np.maximum(0.1 * damping[gain], 1e-9)
        damping[active[~better]] = 10.0 * np.maximum(damping[active[~better]], 1e-6)
        active = np.concatenate(
            [gain[relative > _CONVERGED], active[~better][damping[active[~better]] < 1e4]]
        )
        if not len(active):
            break
    return Solution(pose, np.where(seen, distance, np.nan), cost)


def _prior_terms(pose: Pose, prior: Pose | None, weight: Array) -> tuple[Array, Array]:
    """Gradient ``(n, 40)`` and curvature ``(n, 40)`` of the prior on joints."""
    n = len(pose)
    pull, strength = np.zeros((n, N_VELOCITY)), np.zeros((n, N_VELOCITY))
    turns = _deviation(pose, prior)
    for k in range(1, N_SEGMENTS):
        columns = COLUMNS[k]
        square = weight[:, k, None] ** 2
        if columns.stop - columns.start == 3:
            pull[:, columns] = -square * turns[:, k]
        else:
            beyond = _overextension(pose, k)
            pull[:, columns] = -square * (turns[:, k] @ REVOLUTE_AXIS[k])[:, None]
            pull[:, columns] += _HINGE_SPRING**2 * beyond[:, None]
            strength[:, columns] = _HINGE_SPRING**2 * (beyond > 0.0)[:, None]
        strength[:, columns] += square
    return pull, strength


def _overextension(pose: Pose, k: int) -> Array:
    """How far a hinge is bent the wrong way, ``(n,)`` [rad]."""
    return np.maximum(0.0, _HINGE_LEAST - logarithm(pose.rotation[:, k]) @ REVOLUTE_AXIS[k])


def _deviation(pose: Pose, prior: Pose | None) -> Array:
    rotation = pose.rotation if prior is None else prior.rotation.transpose(0, 1, 3, 2) @ pose.rotation
    return logarithm(rotation)


def _cost(
    model: MarkerModel,
    target: Array,
    seen: NDArray[np.bool_],
    pose: Pose,
    robust: bool,
    prior: Pose | None,
    weight: Array,
) -> tuple[Array, Array]:
    """Cost of each frame and distance of each marker."""
    distance = np.linalg.norm(target - model.predicted(pose), axis=2)
    square = (distance / _SIGMA) ** 2
    if robust:
        square = square / (1.0 + (distance / _CORE) ** 2)
    turns = np.linalg.norm(_deviation(pose, prior), axis=2)[:, 1:]
    bent = sum(_overextension(pose, k) ** 2 for k in REVOLUTE_AXIS) * _HINGE_SPRING**2
    return (square * seen).sum(axis=1) + ((turns * weight[:, 1:]) ** 2).sum(axis=1) + bent, distance
