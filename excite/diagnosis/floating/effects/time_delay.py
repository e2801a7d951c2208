"""The wrench channels are logged late."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter
from excite.diagnosis.floating.effects.form import Beyond
from excite.diagnosis.floating.equations.record import FloatingRecord
from excite.diagnosis.floating.equations.state import State
from excite.doctor.doubt import Doubt


class TimeDelay(FloatingEffect):
    """reading(t) = true(t − delay), all sensors."""

    name: ClassVar[str] = "time_delay"
    told_by = frozenset({Doubt.CLOCK, Doubt.DELAY})
    reads_as: ClassVar[str] = "nothing else follows the wrench's rate"
    says = Beyond.READINGS

    def locations(self, state: State) -> tuple[str, ...]:
        """The wrench channels as a whole."""
        return ("wrench",)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The delay."""
        return (Parameter("delay", "s", 0.02, 1e-3),)

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Read ahead, trial by trial, by cubic Hermite interpolation."""
        record = state.record
        first, u = _ahead(record, float(theta[0]) * record.rate_hz)
        readings = {}
        for name, logged in record.readings.items():
            rise = logged[first + 1] - logged[first]
            slope = record.readings_rate[name] / record.rate_hz
            bend = slope[first] * (1.0 - u) - slope[first + 1] * u + (2.0 * u - 1.0) * rise
            there = logged[first] + u * rise + u * (1.0 - u) * bend
            readings[name] = state.readings[name] + there - logged
        return state.replace(readings=readings)


def _ahead(record: FloatingRecord, samples: float) -> tuple[NDArray[np.int64], Array]:
    """For each sample, the one before where it is read, ``(n,)``, and how far after that, ``(n, 1)`` from 0 to 1.

    Beyond a trial's ends nothing is known: there the ends are read.
    """
    first, u = np.empty(record.n_samples, dtype=int), np.empty(record.n_samples)
    for span in record.spans:
        n = span.stop - span.start
        place = np.clip(np.arange(n) + samples, 0, n - 1)
        before = np.minimum(place.astype(int), n - 2)
        first[span], u[span] = span.start + before, place - before
    return first, u[:, None]
