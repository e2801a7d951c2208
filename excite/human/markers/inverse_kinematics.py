"""Postures from markers: weighted least squares, many frames at a time.

Every frame minimises ``Σ ρ(|p_m − x_m(q)|) + prior``, solved by damped Gauss-Newton steps on the segments'
rotations, so that no posture is singular. Markers that are missing have no term; the prior, so weak that markers
overrule it, holds what no marker says.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from excite.arrays import Array, Flags, Indices
from excite.human.segments import (
    COLUMNS,
    DESCENDANTS,
    N_SEGMENTS,
    N_VELOCITY,
    NAMES,
    PARENTS,
    REVOLUTE_AXIS,
    Placement,
    Pose,
    neutral_pose,
    place_segments,
)


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
    segment: Indices
    local: Array
    offsets: Array

    def predict_markers(self, pose: Pose) -> Array:
        """World positions of the markers, ``(n, m, 3)`` [m]."""
        return place_segments(pose, self.offsets).locate_points(self.segment, self.local)


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
        points: measured positions ``(n, m, 3)`` [m], NaN where a marker is missing.
        start: first guess, ``n`` frames.
        steps: most iterations.
        robust: whether far markers count less.
        prior: postures that the prior pulls to; standing if None.
        prior_weight: ``(n, 15)`` one over the prior's standard deviation of each joint [1/rad]; weak if None.

    Returns:
        The solution.
    """
    n = len(points)
    weight = np.full((n, N_SEGMENTS), 0.5) if prior_weight is None else prior_weight
    standing = np.broadcast_to((neutral_pose() if prior is None else prior).rotation, start.rotation.shape)
    parts = []
    for first in range(0, n, _BLOCK):
        part = slice(first, first + _BLOCK)
        parts.append(
            _fit_frames(model, points[part], start[part], standing[part], weight[part], steps, robust=robust)
        )
    pose = Pose(
        *(np.concatenate([getattr(one.pose, name) for one in parts]) for name in ("position", "rotation"))
    )
    return Solution(
        pose, np.concatenate([one.residual for one in parts]), np.concatenate([one.cost for one in parts])
    )


# Damped Gauss-Newton steps of many frames at a time (Levenberg-Marquardt, each frame with its own damping).

# Frames solved at a time, for memory: their normal matrices are 13 kB each.
_BLOCK = 200
_SIGMA = 0.01
# Markers count fully up to this distance [m] and less beyond (Geman-McClure), so that a swapped one is let go.
_CORE = 0.03
# Elbows and knees bend one way only; beyond a little overextension a stiff spring keeps them from folding over.
_HINGE_LEAST, _HINGE_SPRING = -0.15, 20.0


@dataclass(eq=False)
class _State:
    """Frames at some postures: what Gauss-Newton steps start from.

    Attributes:
        pose: the postures.
        placed: the segments.
        points: markers where the postures have them ``(n, m, 3)`` [m].
        distance: from where they are ``(n, m)`` [m].
        turns: of each joint away from the prior ``(n, 15, 3)`` [rad].
        bent: how far each hinge is bent the wrong way ``(n, n_hinges)`` [rad].
        cost: ``(n,)``.
    """

    pose: Pose
    placed: Placement
    points: Array
    distance: Array
    turns: Array
    bent: Array
    cost: Array

    def take_frames(self, frames: Indices, other: _State, chosen: Flags) -> None:
        """Take some frames of another state, which is of ``frames``."""
        for own, new in zip(self._arrays(), other._arrays(), strict=True):
            own[frames[chosen]] = new[chosen]

    def _arrays(self) -> tuple[Array, ...]:
        pose, placed = self.pose, self.placed
        own = (self.points, self.distance, self.turns, self.bent, self.cost)
        return (pose.position, pose.rotation, placed.origin, placed.rotation, *own)


def _fit_frames(
    model: MarkerModel, points: Array, start: Pose, prior: Array, weight: Array, steps: int, *, robust: bool
) -> Solution:
    seen = np.asarray(np.isfinite(points).all(axis=2))
    target = np.where(seen[:, :, None], points, 0.0)

    def evaluate(pose: Pose, frames: Indices) -> _State:
        return _state_of(
            model, pose, target[frames], seen[frames], prior[frames], weight[frames], robust=robust
        )

    active = np.arange(len(points))
    state = evaluate(start.copy(), active)
    damping = np.full(len(points), 1e-3)
    diagonal = np.arange(N_VELOCITY)
    for _ in range(steps):
        if not len(active):
            break
        normal, gradient = _normal_equations(model, state, active, target, seen, weight, robust=robust)
        normal[:, diagonal, diagonal] = (normal[:, diagonal, diagonal] + 1e-9) * (1.0 + damping[active, None])
        step: Array = np.asarray(np.linalg.solve(normal, gradient[:, :, None])[:, :, 0])
        # A step of more than half a radian leaves the region in which the linearisation means anything.
        step *= np.minimum(1.0, 0.5 / np.maximum(np.abs(step[:, 3:]).max(axis=1), 1e-12))[:, None]
        trial = evaluate(state.pose[active].take_step(step), active)
        old = state.cost[active]
        better = trial.cost <= old * (1.0 + 1e-12)
        gain = (old - trial.cost) / np.maximum(old, 1e-12)
        state.take_frames(active, trial, better)
        now = damping[active]
        damping[active] = np.where(better, np.maximum(0.1 * now, 1e-9), 10.0 * np.maximum(now, 1e-6))
        done = np.where(better, gain <= 1e-6, damping[active] >= 1e4)
        active = active[~done]
    return Solution(state.pose, np.where(seen, state.distance, np.nan), state.cost)


def _state_of(
    model: MarkerModel, pose: Pose, target: Array, seen: Flags, prior: Array, weight: Array, *, robust: bool
) -> _State:
    placed = place_segments(pose, model.offsets)
    points = placed.locate_points(model.segment, model.local)
    square = ((target - points) ** 2).sum(axis=2)
    part = square / _SIGMA**2
    markers = np.where(seen, part / (1.0 + square / _CORE**2) if robust else part, 0.0)
    turns = _rotation_vectors(prior.swapaxes(-1, -2) @ pose.rotation)
    own = _rotation_vectors(pose.rotation[:, _HINGES])
    bent = np.maximum(0.0, _HINGE_LEAST - np.einsum("nki,ki->nk", own, _HINGE_AXES))
    pulls = (weight[:, 1:] ** 2 * (turns[:, 1:] ** 2).sum(axis=2)).sum(axis=1)
    cost = markers.sum(axis=1) + pulls + ((_HINGE_SPRING * bent) ** 2).sum(axis=1)
    return _State(pose, placed, points, np.sqrt(square), turns, bent, cost)


def _rotation_vectors(rotation: Array) -> Array:
    """Rotation vectors of matrices ``(…, 3, 3)``, angle up to π."""
    turn = Rotation.from_matrix(rotation.reshape(-1, 3, 3), assume_valid=True)
    return turn.as_rotvec().reshape(rotation.shape[:-1])


def _normal_equations(
    model: MarkerModel,
    state: _State,
    frames: Indices,
    target: Array,
    seen: Flags,
    weight: Array,
    *,
    robust: bool,
) -> tuple[Array, Array]:
    """Normal matrices ``(n, 40, 40)`` and gradients ``(n, 40)`` of some frames.

    Markers are point masses of their weights that hang on the tree of segments: the normal matrix is that tree's mass
    matrix, of composite bodies (Featherstone 2008, Rigid Body Dynamics Algorithms, section 6.2).
    """
    n, origin, points = len(frames), state.placed.origin[frames], state.points[frames]
    counts = np.where(seen[frames], _SIGMA**-2, 0.0)
    if robust:
        counts /= (1.0 + (state.distance[frames] / _CORE) ** 2) ** 2
    # Of what each joint carries, about the pelvis: weight, first and second moments; force and moment of the pull.
    place = points - origin[:, :1]
    pull = counts[:, :, None] * (target[frames] - points)
    weighed = counts[:, :, None] * place
    second = (weighed[:, :, :, None] * place[:, :, None, :]).reshape(n, -1, 9)
    terms = np.concatenate([counts[:, :, None], weighed, second, pull, np.cross(place, pull)], axis=2)
    mass, first, moments, wrench = np.split(_BEARS.take(model.segment, axis=1) @ terms, [1, 4, 13], axis=2)
    # Their inertia: momentum, linear and angular, of a velocity about the pelvis.
    moments = moments.reshape(n, N_SEGMENTS, 3, 3)
    spread = np.trace(moments, axis1=2, axis2=3)[:, :, None, None] * np.eye(3)
    cross = np.cross(first[:, :, None, :], np.eye(3))
    inertia = np.block([[mass[:, :, :, None] * np.eye(3), cross], [-cross, spread - moments]])
    # Velocity about the pelvis that each column gives what it carries.
    angular = _JOINT_AXES @ state.placed.rotation[frames].swapaxes(2, 3)
    linear = np.cross((origin - origin[:, :1])[:, :, None], angular)
    velocity = np.concatenate([linear, angular], axis=3)
    momentum = velocity @ inertia
    axes, impulse = (
        np.concatenate([part[:, 0], part.reshape(n, -1, 6)[:, _ROWS]], axis=1)
        for part in (velocity, momentum)
    )
    axes[:, :3], impulse[:, :3] = np.eye(3, 6), inertia[:, 0, :3]
    normal = impulse @ axes.swapaxes(1, 2)
    normal *= _CARRIES
    normal += normal.swapaxes(1, 2) * _BEYOND
    gradient = np.einsum("nci,nci->nc", axes, wrench[:, _SEGMENT_OF])
    # What the prior and the hinges' springs pull.
    square = (weight[frames] ** 2)[:, _SEGMENT_OF]
    square[:, : COLUMNS[0].stop] = 0.0
    turns = (state.turns[frames][:, :, None] * _JOINT_AXES).sum(axis=3).reshape(n, -1)
    gradient[:, 3:] -= square[:, 3:] * turns[:, _ROWS]
    square[:, _HINGE_COLUMNS] += _HINGE_SPRING**2 * (state.bent[frames] > 0.0)
    gradient[:, _HINGE_COLUMNS] += _HINGE_SPRING**2 * state.bent[frames]
    normal[:, np.arange(N_VELOCITY), np.arange(N_VELOCITY)] += square
    return normal, gradient


# Which segments each joint bears.
_BEARS = np.array([[float(k in below) for k in range(N_SEGMENTS)] for below in DESCENDANTS])
# Of each of the 40 columns its segment, and which columns carry it. Those of turns, all but the first three, are rows
# of a table of three axes a joint, in the segment's frame.
_SEGMENT_OF = np.repeat(np.arange(N_SEGMENTS), [columns.stop - columns.start for columns in COLUMNS])
_JOINT_AXES = np.array([np.eye(3)] * N_SEGMENTS)
_JOINT_AXES[list(REVOLUTE_AXIS), 0] = list(REVOLUTE_AXIS.values())
_ROWS = np.array([3 * k + c - max(COLUMNS[k].start, COLUMNS[k].stop - 3) for c, k in enumerate(_SEGMENT_OF)])[
    3:
]
_CARRIES = np.array([[c in DESCENDANTS[j] for j in _SEGMENT_OF] for c in _SEGMENT_OF])
_BEYOND = _CARRIES.T & ~_CARRIES
_HINGES = np.array(list(REVOLUTE_AXIS))
_HINGE_AXES = np.array(list(REVOLUTE_AXIS.values()))
_HINGE_COLUMNS = np.array([COLUMNS[k].start for k in REVOLUTE_AXIS])


FEWEST_MARKERS = 3
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
        if k in _SPHERICAL and (part.segment == k).sum() >= FEWEST_MARKERS:
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
    rotation[seen.sum(axis=1) < FEWEST_MARKERS] = np.eye(3)
    origin = middle - np.einsum("nij,nj->ni", rotation, own_middle)
    return rotation, origin
