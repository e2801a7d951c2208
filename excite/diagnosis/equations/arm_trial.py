"""One trial of a fixed-base arm on a uniform grid, and the frequencies of its comparison."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from excite.arrays import Array


@dataclass(frozen=True)
class Bands:
    """Frequencies of the comparison [Hz].

    Attributes:
        rows_hz: cut-off of the filter on both sides of the equations.
        kinematics_hz: cut-off before differentiation; wider, so that friction sees reversals sharply.
        rate_hz: rate of the rows after decimation.
    """

    rows_hz: float = 10.0
    kinematics_hz: float = 30.0
    rate_hz: float = 50.0


@dataclass(frozen=True, eq=False)
class ArmTrial:
    """One trial at its full rate.

    Attributes:
        name: stem of its file.
        identification: whether it is an identification trial.
        repeats: name of the trial whose command it repeats.
        time: ``(n,)`` [s] from the trial's start.
        session_s: ``(n,)`` [s] since the session's start.
        q: ``(n, n_joints)`` in the model's order; v, a alike [rad, rad/s, rad/s²].
        v: velocities.
        a: accelerations.
        tau: ``(n, n_joints)`` unfiltered torque, the log's joints in the model's order, less what is known [N·m].
        rows: indices of the rows that are kept.
        q_cmd: commanded positions, as ``q``; None where there are none.
        beyond: ``(n, n_joints)`` where a torque was beyond the range of what measured it, or lost, and ``tau`` is a
            guess; None where it never was.
        known: torque of drives whose friction and rotor inertia are known, as ``tau``; None where none are.
    """

    name: str
    identification: bool
    repeats: str | None
    time: Array
    session_s: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    rows: NDArray[np.int64]
    q_cmd: Array | None = None
    known: Array | None = None
    beyond: NDArray[np.bool_] | None = None

    @cached_property
    def torque_spline(self) -> CubicSpline:
        """Unfiltered torque as it was measured, between its samples too."""
        return CubicSpline(self.time, self.measured_torque)

    @property
    def measured_torque(self) -> Array:
        """Unfiltered torque as it was measured, as ``tau`` [N·m]."""
        return self.tau if self.known is None else self.tau + self.known
