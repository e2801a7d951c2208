"""Whether feet span an area on which a robot could stand."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array

# Half the margin that the balance check asks for on either side [m]: nothing narrower can be safe.
_NARROW = 0.015


def has_area(corners: Array) -> bool:
    """Whether points ``(n, 2)`` span a polygon, wider than :data:`_NARROW`, on which a robot could stand."""
    if len(corners) < 3:
        return False
    # Twice the spread across the narrowest direction is about the polygon's half width.
    return bool(np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)[-1] > _NARROW)
