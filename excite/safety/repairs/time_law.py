"""How fast a path is run: the path parameter as a smooth function of time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from excite.arrays import Array


@dataclass(frozen=True, eq=False)
class TimeLaw:
    """``s(t)`` as a cubic spline that starts and ends with ``ṡ`` as given.

    Attributes:
        time: knots, ``(n,)`` [s], from 0.
        s: path parameter at the knots, ``(n,)``, not decreasing.
        rate: ``ṡ`` at the first and the last knot [1/s].
    """

    time: Array
    s: Array
    rate: tuple[float, float] = (0.0, 0.0)

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""
        return float(self.time[-1])

    @cached_property
    def _spline(self) -> scipy.interpolate.CubicSpline:
        return scipy.interpolate.CubicSpline(
            self.time, self.s, bc_type=((1, self.rate[0]), (1, self.rate[1]))
        )

    def evaluate(self, time: Array, order: int = 0) -> Array:
        """``s``, ``ṡ`` or ``s̈`` at times ``(n,)``; the value of ``s`` never leaves the path's interval."""
        values = self._spline(np.clip(time, 0.0, self.duration), order)
        return np.asarray(np.clip(values, self.s[0], self.s[-1]) if order == 0 else values)

    def faster(self, k: float) -> TimeLaw:
        """The same law ``k`` times as fast."""
        return TimeLaw(self.time / k, self.s, (self.rate[0] * k, self.rate[1] * k))
