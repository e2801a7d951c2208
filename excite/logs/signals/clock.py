"""Whether time stamps say when samples were taken."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array


def cubic_misfit(time: Array, values: Array) -> Array:
    """Distance of each sample from the cubic through two neighbours on either side, ``(n − 4, …)``.

    Scaled so that white noise of standard deviation 1 gives 1.
    """
    n = len(time)
    centre = time[2 : n - 2]
    places = [slice(0, n - 4), slice(1, n - 3), slice(3, n - 1), slice(4, n)]
    nodes = np.stack([time[place] for place in places])
    weights = np.ones_like(nodes)
    for i in range(4):
        for j in range(4):
            if i != j:
                weights[i] *= (centre - nodes[j]) / (nodes[i] - nodes[j])
    shape = (-1,) + (1,) * (values.ndim - 1)
    predicted = sum(w.reshape(shape) * values[place] for w, place in zip(weights, places, strict=True))
    scale = np.sqrt(1.0 + (weights**2).sum(axis=0)).reshape(shape)
    return np.asarray((values[2 : n - 2] - predicted) / scale)
