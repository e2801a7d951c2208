"""Numba loops over the tree of segments: kinematics, normal equations of markers, and their solution.

Markers are point masses of their weights that hang on the tree. The normal matrix of the least-squares step is then
the tree's mass matrix and comes from composite bodies, and it is factorised along the tree without fill-in
(Featherstone 2008, Rigid Body Dynamics Algorithms, sections 6.2 and 6.5).
"""

from __future__ import annotations

import numpy as np

from excite.human.posture.skeleton import COLUMNS, N_SEGMENTS, N_VELOCITY, REVOLUTE_AXIS
from excite.human.segments import PARENTS
from excite.lazy_kernel import LazyKernel

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
