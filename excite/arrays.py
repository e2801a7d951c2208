"""The type of arrays that signatures name.

A module of its own, free of other imports, so that filters and readers do not load the robot's libraries for a name.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
