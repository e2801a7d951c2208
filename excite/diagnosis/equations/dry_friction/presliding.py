"""Dry friction before it slips: bristles that bend."""

from __future__ import annotations

import numpy as np

from excite.lazy_kernel import LazyKernel

# Static over Coulomb friction, less one, that is typical, and that bristles are taken to bend further by.
RATIO = 0.7


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


@LazyKernel
def bend_further(v, starts, dt, breakaway, velocity, exponent, ratio):  # pragma: no cover - compiled
    """The LuGre model ``z' = v − |v| z/(breakaway·g)``, returned as z/breakaway, ``(n,)``; starts at rest.

    ``g = 1 + ratio·exp(−|v/velocity|^exponent)``: static over Coulomb friction is 1 + ratio, and bristles bend further
    by as much (Canudas de Wit et al. 1995, eqs. 1 and 4).
    """
    out = np.zeros(len(v))
    s = 0.0
    for i in range(len(v)):
        if starts[i]:
            s = 0.0
        g = 1.0 + ratio * np.exp(-((abs(v[i]) / velocity) ** exponent))
        s = (s + dt * v[i] / breakaway) / (1.0 + dt * abs(v[i]) / (breakaway * g))
        out[i] = s
    return out
