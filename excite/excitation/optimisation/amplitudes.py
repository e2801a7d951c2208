"""The papers' own limits of Fourier series: sums of amplitudes instead of the motion's peaks."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.errors import InputError
from excite.excitation.optimisation.limits import JointLimits
from excite.excitation.optimisation.objective import Layout
from excite.motion.generators.curves import FourierCurve
from excite.motion.generators.fourier import amplitude_scale

# Keeps the root's derivative finite where an amplitude vanishes, as a share of the velocity limit.
_ROUNDING = 1e-4


class AmplitudeSums:
    """Sums of amplitudes of eq. (10) of Xu et al. 2020, in shares of the limits, two rows a joint.

    Args:
        layout: of a Fourier family.
        limits: joint limits; positions are counted from the offset to the nearer end.

    Raises:
        InputError: another family, or a start that is to be chosen (the sums are about a given one).
    """

    def __init__(self, layout: Layout, limits: JointLimits) -> None:
        still = layout.family.curve(np.zeros(1), np.zeros((1, layout.family.n_coefficients)))
        if not isinstance(still, FourierCurve) or layout.free_offset:
            raise InputError(
                "sums of amplitudes of a motion that is no series about a given start",
                field="amplitude_sums",
                remedy="use a Fourier family and a fixed start",
            )
        self._layout, self._omega = layout, still.omega
        unit = layout.family.curve(
            np.zeros(layout.family.n_coefficients), np.eye(layout.family.n_coefficients)
        )
        if not isinstance(unit, FourierCurve):
            raise InputError("no Fourier series", field="amplitude_sums")
        self._a, self._b = unit.a, unit.b
        joints = layout.joints
        self._reach = np.minimum(limits.upper[joints] - layout.start, layout.start - limits.lower[joints])
        self._speed = limits.velocity[joints]

    def rows(self, x: Array) -> tuple[Array, Array]:
        """What is left of each limit, ``(2·n_moved,)``, and its gradient ``(2·n_moved, size)``."""
        table = self._layout.parts(x)[1]
        a, b = table @ self._a, table @ self._b
        number = np.arange(1, a.shape[1] + 1)
        size = np.sqrt(a**2 + b**2 + (_ROUNDING * self._speed[:, None]) ** 2)
        n = len(self._speed)
        by_table = np.zeros((2 * n, *table.shape))
        left = np.empty(2 * n)
        for k, weight in enumerate((1.0 / (number * self._omega), np.ones(len(number)))):
            limit = (self._reach, self._speed)[k]
            left[k * n : (k + 1) * n] = 1.0 - (size * weight).sum(axis=1) / limit
            slope = -((a / size * weight) @ self._a.T + (b / size * weight) @ self._b.T) / limit[:, None]
            by_table[k * n + np.arange(n), np.arange(n)] = slope
        return left, self._layout.gathered(np.zeros((2 * n, n)), by_table)

    def shares(self, x: Array) -> Array:
        """Largest share of its limits that each joint uses, ``(n_moved,)``."""
        table = self._layout.parts(x)[1]
        a, b = table @ self._a, table @ self._b
        return 1.0 / amplitude_scale(a, b, self._omega, self._reach, self._speed)
