"""Shares of torques that model and drive leave, for many mixtures of models at once; compiled."""

from __future__ import annotations

import numpy as np

from excite.lazy_kernel import LazyKernel


@LazyKernel
def product(x, y):
    """Sum of the products of two arrays ``(n,)``, in four sums that do not wait for each other."""
    a = b = c = d = 0.0
    end = len(x) - len(x) % 4
    for k in range(0, end, 4):
        a += x[k] * y[k]
        b += x[k + 1] * y[k + 1]
        c += x[k + 2] * y[k + 2]
        d += x[k + 3] * y[k + 3]
    for k in range(end, len(x)):
        a += x[k] * y[k]
    return (a + b) + (c + d)


@LazyKernel
def remove_mean(x):
    """Take the mean of an array ``(n,)`` off."""
    total = 0.0
    for k in range(len(x)):
        total += x[k]
    for k in range(len(x)):
        x[k] -= total / len(x)


@LazyKernel
def factor_chosen(gram, places, n, root):
    """Cholesky factor of a matrix's first ``n`` chosen rows and columns, into ``root``."""
    for i in range(n):
        for j in range(i + 1):
            value = gram[places[i], places[j]]
            for k in range(j):
                value -= root[i, k] * root[j, k]
            root[i, j] = np.sqrt(value) if i == j else value / root[j, j]


@LazyKernel
def solve_factored(root, n, x):
    """Solution of a factored system in place of its right side; what it takes off the squares, and its least value."""
    gain = 0.0
    for i in range(n):
        for k in range(i):
            x[i] -= root[i, k] * x[k]
        x[i] /= root[i, i]
        gain += x[i] * x[i]
    least = np.inf
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= root[k, i] * x[k]
        x[i] /= root[i, i]
        least = min(least, x[i])
    return gain, least


@LazyKernel
def solve_nonnegative(gram, right, first, x):
    """Least squares with the unknowns from ``first`` on not negative: the best of all sets of those that are not zero.

    Few unknowns leave few sets, and no tolerance has to be chosen. ``gram (p, p)``, ``right (p,)``, ``x (p,)``.
    """
    p = len(right)
    root, some, places = np.empty((p, p)), np.empty(p), np.empty(p, dtype=np.int64)
    best = -1.0
    # All unknowns come first, none last.
    for mask in range((1 << (p - first)) - 1, -1, -1):
        n = 0
        for i in range(first, p):
            if mask >> (i - first) & 1:
                places[n], some[n] = i, right[i]
                n += 1
        factor_chosen(gram, places, n, root)
        gain, least = solve_factored(root, n, some)
        if least >= 0.0 and gain > best:
            best = gain
            for i in range(first, p):
                x[i] = 0.0
            for i in range(n):
                x[places[i]] = some[i]
            if n == p - first:
                return


@LazyKernel
def mix_products(products, mixture, sums):
    """Sums of products of the mixed model and the four columns behind its parts, into ``sums (5, 5)``."""
    k = len(mixture)
    # Loops, not slices: numba takes seconds to compile the assignment of one slice to another.
    for i in range(4):
        sums[0, i] = 0.0
        for c in range(4):
            sums[i + 1, c + 1] = products[k + i, k + c]
    sums[0, 4] = 0.0
    for i in range(k):
        for c in range(k):
            sums[0, 0] += mixture[i] * mixture[c] * products[i, c]
        for c in range(4):
            sums[0, c + 1] += mixture[i] * products[i, k + c]
    for c in range(1, 5):
        sums[c, 0] = sums[0, c]


@LazyKernel
def share_of(sums, low, high, trace):
    """Share of the last column's power that the others leave: gain of the first within bounds, others not negative."""
    gram, scale, right, others, x = np.empty((4, 4)), np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    for i in range(4):
        scale[i] = max(np.sqrt(max(sums[i, i], 0.0)), 1e-300)
        right[i] = (sums[i, 4] - low * sums[i, 0]) / scale[i]
    for i in range(4):
        for c in range(4):
            gram[i, c] = sums[i, c] / scale[i] / scale[c]
        # The normal equations are all that the small problems need; a trace of regularisation keeps them regular.
        gram[i, i] += trace
    solve_nonnegative(gram, right, 0, x)
    most = (high - low) * scale[0]
    if x[0] > most:
        x[0] = most
        for i in range(1, 4):
            others[i] = right[i] - most * gram[i, 0]
        solve_nonnegative(gram, others, 1, x)
    rest = sums[4, 4] - 2.0 * low * sums[0, 4] + low * low * sums[0, 0]
    for i in range(4):
        rest -= 2.0 * x[i] * right[i] + trace * x[i] * x[i]
        for c in range(4):
            rest += x[i] * x[c] * gram[i, c]
    return max(rest, 0.0) / sums[4, 4]


@LazyKernel
def unexplained_shares(torque, models, mixtures, v, sign, a, low, high, least, trace, out):
    """Share of each torque's power that its model and drive leave, into ``out (r, m)``.

    The model of each mixture is the sum of ``models (k, n, m)`` weighted by a row of ``mixtures (r, k)``. ``torque``,
    velocity ``v``, its smooth ``sign`` and acceleration ``a`` are ``(n, m)``. See
    :func:`~excite.doctor.drive_fit.shares_left` for what may be fitted, within ``low`` and
    ``high`` the model's gain; a torque with less than a share ``least`` of its power beside its mean is dead.
    """
    k, n, m = models.shape
    columns, products, sums = np.empty((k + 4, n)), np.empty((k + 4, k + 4)), np.empty((5, 5))
    for j in range(m):
        for t in range(n):
            for i in range(k):
                columns[i, t] = models[i, t, j]
            columns[k, t], columns[k + 1, t], columns[k + 2, t] = v[t, j], sign[t, j], a[t, j]
            columns[k + 3, t] = torque[t, j]
        whole = product(columns[k + 3], columns[k + 3])
        for i in range(k + 4):
            remove_mean(columns[i])
            for c in range(i + 1):
                products[i, c] = products[c, i] = product(columns[i], columns[c])
        # A torque that never changes, filters' rounding aside, is explained by nothing.
        dead = products[k + 3, k + 3] <= least * whole
        for r in range(len(mixtures)):
            mix_products(products, mixtures[r], sums)
            out[r, j] = 1.0 if dead else share_of(sums, low, high, trace)
