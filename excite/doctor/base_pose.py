"""Ways in which a logged base pose may be meant."""

from __future__ import annotations

from enum import Enum

import numpy as np

from excite.arrays import Array


class BasePose(Enum):
    """What the seven columns of a base pose hold; the log's own way first."""

    STATED = "position, quaternion x y z w, of the base in the world"
    SCALAR_FIRST = "quaternion w x y z"
    INVERSE = "orientation of the world in the base"
    MILLIMETRES = "positions in millimetres"

    def read(self, pose: Array) -> Array:
        """Poses as the log's format has them, ``(n, 7)``, from columns that are meant this way."""
        made = np.array(pose)
        if self is BasePose.SCALAR_FIRST:
            made[:, 3:] = pose[:, [4, 5, 6, 3]]
        elif self is BasePose.INVERSE:
            made[:, 3:6] = -pose[:, 3:6]
        elif self is BasePose.MILLIMETRES:
            made[:, :3] = 1e-3 * pose[:, :3]
        return made
