"""The linear problem that identification solves: rows of a regressor and what was measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from excite.robot.robot import Array, Robot

_BLOCK = 4096


@dataclass(frozen=True, eq=False)
class IdentificationProblem:
    """``Y θ ≈ y``, row by row, with ``θ`` the inertial parameters and then the drives' parameters.

    The first ``n_inertial`` columns are ten per segment in pinocchio's order
    ``m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz`` about the joint frame; the rest are named
    ``viscous.JOINT`` [N·m·s/rad], ``coulomb.JOINT`` [N·m], ``offset.JOINT`` [N·m] and
    ``armature.JOINT`` [kg·m²], as far as the settings ask for them.

    Attributes:
        robot: the robot whose model is identified.
        Y: ``(n_rows, n_params)``.
        y: ``(n_rows,)`` [N·m or N].
        weights: ``(n_rows,)``, one over the standard deviation expected of each row's noise; weighted least
            squares multiplies rows by it.
        channel: ``(n_rows,)`` index into ``channel_names``.
        channel_names: joints' names (joint torque rows) or ``fx fy fz tx ty tz`` (base-link rows, in the
            frame of the base, moment about its origin).
        channel_units: unit of each channel, ``N·m`` or ``N``.
        time: ``(n_rows,)`` time of each row within its trial [s].
        trial: ``(n_rows,)`` index into ``trial_names``.
        trial_names: names of the trials.
        parameter_names: ``(n_params,)`` names: ``LINK.m`` … ``LINK.Izz``, then the drives'.
        prior: ``(n_params,)`` nominal values; drives' parameters that the robot does not state are 0.
        n_inertial: number of inertial columns, ``10·n_segments``.
        unmeasured: segments (indices into ``robot.segments``) that the sensors do not see; their columns
            are zero and their parameters stay nominal.
        noise_bandwidth: equivalent number of independent noise samples per row, at most 1: rows of a
            filtered signal that lie closer than the filter resolves are not independent.
    """

    robot: Robot
    Y: Array
    y: Array
    weights: Array
    channel: NDArray[np.int64]
    channel_names: tuple[str, ...]
    channel_units: tuple[str, ...]
    time: Array
    trial: NDArray[np.int64]
    trial_names: tuple[str, ...]
    parameter_names: tuple[str, ...]
    prior: Array
    n_inertial: int
    unmeasured: tuple[int, ...] = ()
    noise_bandwidth: float = 1.0

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return len(self.y)

    @property
    def n_params(self) -> int:
        """Number of columns."""
        return self.Y.shape[1]

    def factor(self) -> Array:
        """Upper triangular factor of the weighted rows with the measurement as last column.

        ``R`` of ``diag(weights) · [Y y] = Q R``, ``(k, n_params + 1)`` with ``k ≤ n_params + 1``, gathered
        block by block so that no second copy of ``Y`` is needed; ``‖W(Yθ − y)‖ = ‖R[:, :-1] θ − R[:, -1]‖``.
        """
        r = np.zeros((0, self.n_params + 1))
        for start in range(0, self.n_rows, _BLOCK):
            rows = slice(start, start + _BLOCK)
            block = np.column_stack([self.Y[rows], self.y[rows]]) * self.weights[rows, None]
            r = np.linalg.qr(np.vstack([r, block]), mode="r")
        return r

    def residual(self, parameters: Array) -> Array:
        """Measured minus predicted, ``(n_rows,)``, for ``parameters`` of shape ``(n_params,)``."""
        return self.y - self.Y @ parameters

    def rows_of(self, channel: str) -> NDArray[np.bool_]:
        """Mask of the rows of a channel, ``(n_rows,)``."""
        return self.channel == self.channel_names.index(channel)
