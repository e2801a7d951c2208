"""Nearest points of segments, many pairs at once."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array

# Squared sine below which two segments count as parallel.
_PARALLEL = 1e-12


def closest_points(p0: Array, p1: Array, q0: Array, q1: Array) -> tuple[Array, Array]:
    """Nearest points of segments ``p0 p1`` and ``q0 q1`` (Ericson 2005, section 5.1.9), ``(m, 3)`` each."""
    d1, d2, r = p1 - p0, q1 - q0, p0 - q0
    a, e = np.einsum("mi,mi->m", d1, d1), np.einsum("mi,mi->m", d2, d2)
    b, c, f = (np.einsum("mi,mi->m", x, y) for x, y in ((d1, d2), (d1, r), (d2, r)))
    safe_a, safe_e = np.where(a > 0.0, a, 1.0), np.where(e > 0.0, e, 1.0)
    cross = a * e - b * b
    skew = cross > _PARALLEL * a * e
    s = np.where(skew, np.clip((b * f - c * e) / np.where(skew, cross, 1.0), 0.0, 1.0), 0.0)
    t = np.where(e > 0.0, (b * s + f) / safe_e, 0.0)
    clipped = np.clip(t, 0.0, 1.0)
    # Where the second parameter was clipped, or the second segment is a point, the first follows from it.
    again = np.where(a > 0.0, np.clip((b * clipped - c) / safe_a, 0.0, 1.0), 0.0)
    s = np.where((t != clipped) | (e == 0.0), again, s)
    return p0 + s[:, None] * d1, q0 + clipped[:, None] * d2
