"""The wrench channels are logged late."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter
from excite.diagnosis.floating.state import State
from excite.robot.robot import Array


class TimeDelay(FloatingEffect):
    """reading(t) = true(t − delay), all sensors."""

    name: ClassVar[str] = "time_delay"
    reads_as: ClassVar[str] = "nothing else follows the wrench's rate"
    changes_readings: ClassVar[bool] = True

    def locations(self, state: State) -> tuple[str, ...]:
        """The wrench channels as a whole."""
        return ("wrench",)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The delay."""
        return (Parameter("delay", "s", 0.02, 1e-3),)

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Read ahead, trial by trial, by cubic Hermite interpolation."""
        from scipy.interpolate import CubicHermiteSpline

        record, readings = state.record, {}
        for name, logged in record.readings.items():
            change = np.empty_like(logged)
            for span in record.spans:
                t = np.arange(span.stop - span.start) / record.rate_hz
                spline = CubicHermiteSpline(t, logged[span], record.readings_rate[name][span])
                change[span] = spline(np.clip(t + theta[0], t[0], t[-1])) - logged[span]
            readings[name] = state.readings[name] + change
        return state.but(readings=readings)
