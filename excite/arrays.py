"""The type of arrays that signatures name.

A module of its own, free of other imports, so that filters and readers do not load the robot's libraries for a name.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Moved(NamedTuple):
    """Where something is and how it moves, in the same rows.

    Attributes:
        q: configurations, or positions.
        v: velocities.
        a: accelerations.
    """

    q: Array
    v: Array
    a: Array
