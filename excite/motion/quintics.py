"""Compiled loops that evaluate the quintic polynomials which a motion follows between its samples.

A free base's step from one sample to the next is a twist of the frame that it starts from: ``M₁ = M₀ exp(step)`` on
SE(3), the linear part of the twist first, as in pinocchio.
"""

from __future__ import annotations

import math

import numpy as np

from excite.lazy_kernel import LazyKernel

# Squared angles below which sines and cosines are replaced by the first terms of their series, of which those left out
# are then below a double's rounding.
_SMALL = 1e-6


@LazyKernel
def base_step(start, end, step):
    """The twist ``step`` ``(6,)`` from one pose, position and quaternion x y z w ``(7,)``, to another [m, rad]."""
    ax, ay, az, aw = start[3], start[4], start[5], start[6]
    bx, by, bz, bw = end[3], end[4], end[5], end[6]
    # The turn from one to the other, the short way round.
    x = aw * bx - ax * bw - ay * bz + az * by
    y = aw * by + ax * bz - ay * bw - az * bx
    z = aw * bz - ax * by + ay * bx - az * bw
    w = aw * bw + ax * bx + ay * by + az * bz
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    sine = math.sqrt(x * x + y * y + z * z)
    angle = 2.0 * math.atan2(sine, w)
    square = angle * angle
    scale = 2.0 * (1.0 + square / 24.0) if square < _SMALL else angle / sine
    rx, ry, rz = scale * x, scale * y, scale * z
    # The way, in the axes of the start.
    dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    tx, ty, tz = 2.0 * (ay * dz - az * dy), 2.0 * (az * dx - ax * dz), 2.0 * (ax * dy - ay * dx)
    px = dx - aw * tx + (ay * tz - az * ty)
    py = dy - aw * ty + (az * tx - ax * tz)
    pz = dz - aw * tz + (ax * ty - ay * tx)
    bend = 1.0 / 12.0 + square / 720.0
    if square >= _SMALL:
        bend = (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / square
    cx, cy, cz = ry * pz - rz * py, rz * px - rx * pz, rx * py - ry * px
    step[0] = px - 0.5 * cx + bend * (ry * cz - rz * cy)
    step[1] = py - 0.5 * cy + bend * (rz * cx - rx * cz)
    step[2] = pz - 0.5 * cz + bend * (rx * cy - ry * cx)
    step[3], step[4], step[5] = rx, ry, rz


@LazyKernel
def move_base(start, step, end):
    """The pose ``end`` ``(7,)`` that a twist ``(6,)`` takes a pose to; arguments as of :func:`base_step`."""
    ax, ay, az, aw = start[3], start[4], start[5], start[6]
    px, py, pz, rx, ry, rz = step[0], step[1], step[2], step[3], step[4], step[5]
    square = rx * rx + ry * ry + rz * rz
    half, first, second, cosine = (
        0.5 - square / 48.0,
        0.5 - square / 24.0,
        1.0 / 6.0 - square / 120.0,
        1.0 - square / 8.0,
    )
    if square >= _SMALL:
        angle = math.sqrt(square)
        half, cosine = math.sin(0.5 * angle) / angle, math.cos(0.5 * angle)
        first, second = (1.0 - math.cos(angle)) / square, (angle - math.sin(angle)) / (square * angle)
    cx, cy, cz = ry * pz - rz * py, rz * px - rx * pz, rx * py - ry * px
    dx = px + first * cx + second * (ry * cz - rz * cy)
    dy = py + first * cy + second * (rz * cx - rx * cz)
    dz = pz + first * cz + second * (rx * cy - ry * cx)
    tx, ty, tz = 2.0 * (ay * dz - az * dy), 2.0 * (az * dx - ax * dz), 2.0 * (ax * dy - ay * dx)
    end[0] = start[0] + dx + aw * tx + (ay * tz - az * ty)
    end[1] = start[1] + dy + aw * ty + (az * tx - ax * tz)
    end[2] = start[2] + dz + aw * tz + (ax * ty - ay * tx)
    bx, by, bz, bw = half * rx, half * ry, half * rz, cosine
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    w = aw * bw - ax * bx - ay * by - az * bz
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    end[3], end[4], end[5], end[6] = x / norm, y / norm, z / norm, w / norm


@LazyKernel
def evaluate_quintics(instants, q, v, a, starts, shares, q_at, v_at, a_at):
    """Fill in a floating robot's motion at other times.

    Args:
        instants: ``(n,)`` times of its samples [s].
        q, v, a: samples ``(n, nv + 1)``, the base's pose and the joints; ``(n, nv)``; ``(n, nv)``.
        starts: ``(m,)`` index of the sample before each time.
        shares: ``(m,)`` of the interval from there that have passed.
        q_at, v_at, a_at: what is filled in, ``(m, …)``.
    """
    nv = v.shape[1]
    step, way = np.empty(nv), np.empty(nv)
    known = -1
    for i in range(len(starts)):
        k, s = starts[i], shares[i]
        h = instants[k + 1] - instants[k]
        if k != known:
            base_step(q[k], q[k + 1], step)
            for j in range(6, nv):
                step[j] = q[k + 1, j + 1] - q[k, j + 1]
            known = k
        for j in range(nv):
            c1, c2 = h * v[k, j], 0.5 * (h * h) * a[k, j]
            r0 = step[j] - c1 - c2
            r1 = h * v[k + 1, j] - c1 - 2.0 * c2
            r2 = (h * h) * a[k + 1, j] - 2.0 * c2
            c3 = 10.0 * r0 - 4.0 * r1 + 0.5 * r2
            c4 = -15.0 * r0 + 7.0 * r1 - r2
            c5 = 6.0 * r0 - 3.0 * r1 + 0.5 * r2
            way[j] = s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))))
            v_at[i, j] = (c1 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / h
            a_at[i, j] = (2.0 * c2 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) / (h * h)
        move_base(q[k], way, q_at[i])
        for j in range(6, nv):
            q_at[i, j + 1] = q[k, j + 1] + way[j]
