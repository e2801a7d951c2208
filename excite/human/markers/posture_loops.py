"""Numba loops of inverse kinematics: damped Gauss-Newton steps, frame by frame."""

from __future__ import annotations

import numpy as np

from excite.human.markers.tree_loops import (
    FIRST,
    HINGE,
    SIZE,
    marker_equations,
    multiply_matrices,
    place_markers,
    solve_tree,
)
from excite.human.posture.skeleton import N_SEGMENTS, N_VELOCITY
from excite.lazy_kernel import LazyKernel

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
