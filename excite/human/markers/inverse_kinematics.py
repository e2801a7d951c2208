"""Postures from markers: weighted least squares, frame by frame.

Every frame minimises ``Σ ρ(|p_m − x_m(q)|) + prior``, solved by damped Gauss-Newton steps on the segments'
rotations, so that no posture is singular. Markers that are missing have no term; the prior, so weak that markers
overrule it, holds what no marker says.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.human.segments import NAMES, PARENTS
from excite.human.skeleton import (
    COLUMNS,
    N_SEGMENTS,
    N_VELOCITY,
    REVOLUTE_AXIS,
    Pose,
    neutral_pose,
    place_segments,
)
from excite.lazy_kernel import LazyKernel

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


# Numba loops of inverse kinematics: damped Gauss-Newton steps, frame by frame.

_SIGMA = 0.01
# Markers count fully up to this distance [m] and less beyond (Geman-McClure), so that a swapped one is let go.
_CORE = 0.03
# Elbows and knees bend one way only; beyond a little overextension a stiff spring keeps them from folding over.
_HINGE_LEAST, _HINGE_SPRING = -0.15, 20.0
_CONVERGED = 1e-6
# A step of more than half a radian leaves the region in which the linearisation means anything.
_LONGEST_STEP = 0.5


@LazyKernel
def _turn_into(turn, out):
    """Rotation matrix of a rotation vector (Rodrigues)."""
    x, y, z = turn[0], turn[1], turn[2]
    square = x * x + y * y + z * z
    if square < 1e-12:
        a, b = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        angle = np.sqrt(square)
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / square
    out[0, 0], out[0, 1], out[0, 2] = 1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y
    out[1, 0], out[1, 1], out[1, 2] = b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x
    out[2, 0], out[2, 1], out[2, 2] = b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)


@LazyKernel
def _vector_into(r, out):
    """Rotation vector of a rotation matrix, angle up to π."""
    out[0], out[1], out[2] = 0.5 * (r[2, 1] - r[1, 2]), 0.5 * (r[0, 2] - r[2, 0]), 0.5 * (r[1, 0] - r[0, 1])
    sine = np.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    cosine = 0.5 * (r[0, 0] + r[1, 1] + r[2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    if sine > 1e-7:
        for i in range(3):
            out[i] *= angle / sine
    elif cosine < 0.0:
        # Half a turn: the axis stands in the symmetric part.
        big = 0
        for i in range(1, 3):
            if r[i, i] > r[big, big]:
                big = i
        length = np.sqrt(max(0.5 * (r[big, big] + 1.0), 1e-12))
        for i in range(3):
            part = length if i == big else 0.25 * (r[big, i] + r[i, big]) / length
            out[i] = angle * part


@LazyKernel
def _joint_turns(rotation, prior, turns, bent):
    """Turn of each joint away from the prior, and how far each hinge is bent the wrong way."""
    relative = np.empty((3, 3))
    for k in range(1, N_SEGMENTS):
        for i in range(3):
            for j in range(3):
                relative[i, j] = prior[k, 0, i] * rotation[k, 0, j]
                relative[i, j] += prior[k, 1, i] * rotation[k, 1, j] + prior[k, 2, i] * rotation[k, 2, j]
        _vector_into(relative, turns[k])
        bent[k] = 0.0
        if SIZE[k] == 1:
            own = np.empty(3)
            _vector_into(rotation[k], own)
            along = own[0] * HINGE[k, 0] + own[1] * HINGE[k, 1] + own[2] * HINGE[k, 2]
            bent[k] = max(0.0, _HINGE_LEAST - along)


@LazyKernel
def _frame_cost(target, seen, segment, local, world, origin, robust, turns, bent, weight, points, distance):
    """Cost of one frame; fills in predicted points and distances."""
    cost = 0.0
    for m in range(len(segment)):
        k, square = segment[m], 0.0
        for i in range(3):
            points[m, i] = origin[k, i] + world[k, i, 0] * local[m, 0]
            points[m, i] += world[k, i, 1] * local[m, 1] + world[k, i, 2] * local[m, 2]
            square += (target[m, i] - points[m, i]) ** 2
        distance[m] = np.sqrt(square)
        if seen[m]:
            part = square / _SIGMA**2
            cost += part / (1.0 + square / _CORE**2) if robust else part
    for k in range(1, N_SEGMENTS):
        cost += (turns[k, 0] ** 2 + turns[k, 1] ** 2 + turns[k, 2] ** 2) * weight[k] ** 2
        cost += (_HINGE_SPRING * bent[k]) ** 2
    return cost


@LazyKernel
def _distance_weight(seen, distance, robust, weight):
    """How much the square of each marker's distance counts."""
    for m in range(len(seen)):
        weight[m] = _SIGMA**-2 if seen[m] else 0.0
        if robust:
            weight[m] /= (1.0 + (distance[m] / _CORE) ** 2) ** 2


@LazyKernel
def _add_pulls(turns, bent, weight, normal, gradient):
    """Add what the prior and the hinges' springs pull."""
    for k in range(1, N_SEGMENTS):
        square = weight[k] ** 2
        for j in range(SIZE[k]):
            c = FIRST[k] + j
            normal[c, c] += square
            if SIZE[k] == 3:
                gradient[c] -= square * turns[k, j]
            else:
                for i in range(3):
                    gradient[c] -= square * turns[k, i] * HINGE[k, i]
                gradient[c] += _HINGE_SPRING**2 * bent[k]
                normal[c, c] += _HINGE_SPRING**2 if bent[k] > 0.0 else 0.0


@LazyKernel
def _shorten_step(step):
    """Make a step no longer than its linearisation holds."""
    largest = 0.0
    for c in range(3, N_VELOCITY):
        largest = max(largest, abs(step[c]))
    if largest > _LONGEST_STEP:
        for c in range(N_VELOCITY):
            step[c] *= _LONGEST_STEP / largest


@LazyKernel
def _apply_step(rotation, step, out):
    """Rotations after a step ``(40,)``."""
    turn, little = np.empty(3), np.empty((3, 3))
    for k in range(N_SEGMENTS):
        for i in range(3):
            if SIZE[k] == 1:
                turn[i] = step[FIRST[k]] * HINGE[k, i]
            else:
                turn[i] = step[FIRST[k] + SIZE[k] - 3 + i]
        _turn_into(turn, little)
        multiply_matrices(rotation[k], little, out[k])


@LazyKernel
def _copy_pose(position, rotation, to_position, to_rotation):
    for i in range(3):
        to_position[i] = position[i]
    for k in range(N_SEGMENTS):
        for i in range(3):
            for j in range(3):
                to_rotation[k, i, j] = rotation[k, i, j]


@LazyKernel
def fit_frames(
    target, seen, position, rotation, prior, weight, offsets, segment, local, steps, robust, distance, cost
):
    """Fit every frame by damped Gauss-Newton steps, postures in place.

    Args:
        target: ``(n, m, 3)`` positions, anything where not seen [m].
        seen: ``(n, m)``.
        position: of the pelvis ``(n, 3)``, first guess in, answer out.
        rotation: ``(n, 15, 3, 3)``, likewise.
        prior: rotations that joints are pulled to ``(n, 15, 3, 3)``, or one frame of them.
        weight: of that pull ``(n, 15)`` [1/rad].
        offsets: of the joints ``(15, 3)``.
        segment: of each marker ``(m,)``.
        local: place of each marker ``(m, 3)``.
        steps: most iterations.
        robust: whether far markers count less.
        distance: of each marker ``(n, m)``, written.
        cost: of each frame ``(n,)``, written.
    """
    m = len(segment)
    world, new_world = np.empty((N_SEGMENTS, 3, 3)), np.empty((N_SEGMENTS, 3, 3))
    origin, new_origin = np.empty((N_SEGMENTS, 3)), np.empty((N_SEGMENTS, 3))
    points, new_points = np.empty((m, 3)), np.empty((m, 3))
    far, new_far, counts = np.empty(m), np.empty(m), np.empty(m)
    turns, new_turns = np.zeros((N_SEGMENTS, 3)), np.zeros((N_SEGMENTS, 3))
    bent, new_bent = np.zeros(N_SEGMENTS), np.zeros(N_SEGMENTS)
    place, new_place = np.empty(3), np.empty(3)
    joints, new_joints = np.empty((N_SEGMENTS, 3, 3)), np.empty((N_SEGMENTS, 3, 3))
    normal, step = np.zeros((N_VELOCITY, N_VELOCITY)), np.empty(N_VELOCITY)
    for n in range(len(target)):
        pulled = prior[n] if len(prior) > 1 else prior[0]
        damping = 1e-3
        _copy_pose(position[n], rotation[n], place, joints)
        place_markers(place, joints, offsets, world, origin)
        _joint_turns(joints, pulled, turns, bent)
        best = _frame_cost(
            target[n], seen[n], segment, local, world, origin, robust, turns, bent, weight[n], points, far
        )
        for _ in range(steps):
            _distance_weight(seen[n], far, robust, counts)
            marker_equations(target[n], counts, segment, world, origin, points, normal, step)
            _add_pulls(turns, bent, weight[n], normal, step)
            for c in range(N_VELOCITY):
                normal[c, c] = (normal[c, c] + 1e-9) * (1.0 + damping)
            solve_tree(normal, step)
            _shorten_step(step)
            for i in range(3):
                new_place[i] = place[i] + step[i]
            _apply_step(joints, step, new_joints)
            place_markers(new_place, new_joints, offsets, new_world, new_origin)
            _joint_turns(new_joints, pulled, new_turns, new_bent)
            new = _frame_cost(
                target[n], seen[n], segment, local, new_world, new_origin, robust, new_turns, new_bent,
                weight[n], new_points, new_far,
            )  # fmt: skip
            if new <= best * (1.0 + 1e-12):
                gain = (best - new) / max(best, 1e-12)
                best = new
                place, new_place, joints, new_joints = new_place, place, new_joints, joints
                world, new_world, origin, new_origin = new_world, world, new_origin, origin
                turns, new_turns, bent, new_bent = new_turns, turns, new_bent, bent
                points, new_points, far, new_far = new_points, points, new_far, far
                damping = max(0.1 * damping, 1e-9)
                if gain <= _CONVERGED:
                    break
            else:
                damping = 10.0 * max(damping, 1e-6)
                if damping >= 1e4:
                    break
        _copy_pose(place, joints, position[n], rotation[n])
        cost[n] = best
        for i in range(m):
            distance[n, i] = far[i]


# Numba loops over the tree of segments: kinematics, normal equations of markers, and their solution.
#
# Markers are point masses of their weights that hang on the tree. The normal matrix of the least-squares step
# is then the tree's mass matrix and comes from composite bodies, and it is factorised along the tree without
# fill-in (Featherstone 2008, Rigid Body Dynamics Algorithms, sections 6.2 and 6.5).

_PARENT = np.array([-1, *PARENTS[1:]])
FIRST = np.array([columns.start for columns in COLUMNS])
SIZE = np.array([columns.stop - columns.start for columns in COLUMNS])
HINGE = np.array([REVOLUTE_AXIS.get(k, np.zeros(3)) for k in range(N_SEGMENTS)])


def _parent_columns() -> np.ndarray:
    """The column before each on its way to the pelvis, -1 for the first."""
    before = np.arange(N_VELOCITY) - 1
    for k in range(1, N_SEGMENTS):
        before[COLUMNS[k].start] = COLUMNS[PARENTS[k]].stop - 1
    return before


_BEFORE = _parent_columns()


@LazyKernel
def multiply_matrices(a, b, out):
    """Product of two matrices of three rows and columns, into ``out (3, 3)``."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@LazyKernel
def place_markers(position, rotation, offsets, world, origin):
    """Forward kinematics of one frame."""
    for i in range(3):
        origin[0, i] = position[i]
        for j in range(3):
            world[0, i, j] = rotation[0, i, j]
    for k in range(1, N_SEGMENTS):
        p = _PARENT[k]
        multiply_matrices(world[p], rotation[k], world[k])
        for i in range(3):
            origin[k, i] = origin[p, i] + world[p, i, 0] * offsets[k, 0]
            origin[k, i] += world[p, i, 1] * offsets[k, 1] + world[p, i, 2] * offsets[k, 2]


@LazyKernel
def _velocity_axes(world, origin):
    """Velocity about the pelvis that each column gives what it carries: linear, angular ``(40, 6)``."""
    axes = np.zeros((N_VELOCITY, 6))
    for k in range(N_SEGMENTS):
        x, y, z = origin[k, 0] - origin[0, 0], origin[k, 1] - origin[0, 1], origin[k, 2] - origin[0, 2]
        for c in range(FIRST[k], FIRST[k] + SIZE[k]):
            if c < 3:
                axes[c, c] = 1.0
                continue
            a = axes[c]
            for i in range(3):
                if SIZE[k] == 1:
                    h = HINGE[k]
                    a[3 + i] = world[k, i, 0] * h[0] + world[k, i, 1] * h[1] + world[k, i, 2] * h[2]
                else:
                    a[3 + i] = world[k, i, (c - FIRST[k]) % 3]
            a[0], a[1], a[2] = y * a[5] - z * a[4], z * a[3] - x * a[5], x * a[4] - y * a[3]
    return axes


@LazyKernel
def marker_equations(target, weight, segment, world, origin, points, normal, gradient):
    """Normal matrix (entries on the tree only) and gradient of weighted markers.

    Args:
        target: where markers are ``(m, 3)`` [m].
        weight: of the square of each one's distance ``(m,)``, 0 where it is not seen.
        segment: that carries each ``(m,)``.
        world: rotations of the segments ``(15, 3, 3)``.
        origin: of the segments ``(15, 3)`` [m].
        points: where the posture has the markers ``(m, 3)`` [m].
        normal: ``(40, 40)``, written where one column carries the other (lower triangle).
        gradient: ``(40,)``, written.
    """
    ref = origin[0]
    # Of the body below each joint about the pelvis: weight, first moment, inertia; force and moment of the pull.
    body, pull = np.zeros((N_SEGMENTS, 10)), np.zeros((N_SEGMENTS, 6))
    for m in range(len(segment)):
        w = weight[m]
        if w == 0.0:
            continue
        x, y, z = points[m, 0] - ref[0], points[m, 1] - ref[1], points[m, 2] - ref[2]
        ex, ey, ez = target[m, 0] - points[m, 0], target[m, 1] - points[m, 1], target[m, 2] - points[m, 2]
        b, f = body[segment[m]], pull[segment[m]]
        b[0] += w
        b[1] += w * x
        b[2] += w * y
        b[3] += w * z
        b[4] += w * (y * y + z * z)
        b[5] += w * (x * x + z * z)
        b[6] += w * (x * x + y * y)
        b[7] -= w * x * y
        b[8] -= w * x * z
        b[9] -= w * y * z
        f[0] += w * ex
        f[1] += w * ey
        f[2] += w * ez
        f[3] += w * (y * ez - z * ey)
        f[4] += w * (z * ex - x * ez)
        f[5] += w * (x * ey - y * ex)
    for k in range(N_SEGMENTS - 1, 0, -1):
        for i in range(10):
            body[_PARENT[k], i] += body[k, i]
        for i in range(6):
            pull[_PARENT[k], i] += pull[k, i]
    axes = _velocity_axes(world, origin)
    for k in range(N_SEGMENTS):
        b = body[k]
        for c in range(FIRST[k], FIRST[k] + SIZE[k]):
            vx, vy, vz, ax, ay, az = axes[c, 0], axes[c, 1], axes[c, 2], axes[c, 3], axes[c, 4], axes[c, 5]
            px = b[0] * vx + ay * b[3] - az * b[2]
            py = b[0] * vy + az * b[1] - ax * b[3]
            pz = b[0] * vz + ax * b[2] - ay * b[1]
            lx = b[2] * vz - b[3] * vy + b[4] * ax + b[7] * ay + b[8] * az
            ly = b[3] * vx - b[1] * vz + b[7] * ax + b[5] * ay + b[9] * az
            lz = b[1] * vy - b[2] * vx + b[8] * ax + b[9] * ay + b[6] * az
            gradient[c] = 0.0
            for i in range(6):
                gradient[c] += axes[c, i] * pull[k, i]
            j = c
            while j >= 0:
                s = axes[j]
                normal[c, j] = s[0] * px + s[1] * py + s[2] * pz + s[3] * lx + s[4] * ly + s[5] * lz
                j = _BEFORE[j]


@LazyKernel
def solve_tree(normal, x):
    """Solve with the tree's matrix in place: ``H = Lᵀ L``, entries only where one column carries the other."""
    for k in range(N_VELOCITY - 1, -1, -1):
        normal[k, k] = np.sqrt(normal[k, k])
        i = _BEFORE[k]
        while i >= 0:
            normal[k, i] /= normal[k, k]
            i = _BEFORE[i]
        i = _BEFORE[k]
        while i >= 0:
            j = i
            while j >= 0:
                normal[i, j] -= normal[k, i] * normal[k, j]
                j = _BEFORE[j]
            i = _BEFORE[i]
    for i in range(N_VELOCITY - 1, -1, -1):
        x[i] /= normal[i, i]
        j = _BEFORE[i]
        while j >= 0:
            x[j] -= normal[i, j] * x[i]
            j = _BEFORE[j]
    for i in range(N_VELOCITY):
        j = _BEFORE[i]
        while j >= 0:
            x[i] -= normal[i, j] * x[j]
            j = _BEFORE[j]
        x[i] /= normal[i, i]


# Postures without a first guess.

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
