"""All of a joint's dry friction builds up over a deflection: a note to the runner, of the baseline's friction too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.diagnosis.effects.bristle import Bristle
from excite.diagnosis.effects.note import Beyond, Note

# What models call it.
PRESLIDING = "presliding"


@dataclass(frozen=True)
class BuildUp(Note):
    """Bristles that hold all of a joint's dry friction.

    Attributes:
        breakaway: deflection over which it builds up [rad].
        damping: of them [N·m·s].
        damped_below: speed up to which they are damped [rad/s].
    """

    breakaway: float
    damping: float | None = None
    damped_below: float | None = None

    beyond = Beyond.FRICTION
    takes_all = True

    @property
    def rubs(self) -> bool:
        return True

    def bristle(self) -> Bristle:
        below = np.inf if self.damped_below is None else self.damped_below
        return Bristle(self.breakaway, self.damping or 0.0, below)
