"""Dry friction before it slips: bristles that bend."""

from __future__ import annotations

import numpy as np

from excite.lazy_kernel import LazyKernel


@LazyKernel
def bend(v, starts, dt, breakaway):  # pragma: no cover - compiled
    """Dahl's model ``z' = v − |v| z/breakaway``, returned as z/breakaway, ``(n,)``; starts at rest."""
    out = np.zeros(len(v))
    s = 0.0
    for i in range(len(v)):
        if starts[i]:
            s = 0.0
        s = (s + dt * v[i] / breakaway) / (1.0 + dt * abs(v[i]) / breakaway)
        out[i] = s
    return out
