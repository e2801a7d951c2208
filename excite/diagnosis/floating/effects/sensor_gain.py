"""A sensor's channel reads too much or too little."""

from __future__ import annotations

from typing import ClassVar

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter
from excite.diagnosis.floating.effects.form import Beyond
from excite.diagnosis.floating.equations.state import State
from excite.doctor.doubt import Doubt
from excite.logs.columns import WRENCH_AXES


class SensorGain(FloatingEffect):
    """Logged = gain × true, on one axis or on all six."""

    name: ClassVar[str] = "sensor_gain"
    told_by = frozenset({Doubt.CLOCK, Doubt.SIZE})
    reads_as: ClassVar[str] = "with free inertials a gain common to all sensors is invisible"
    confusable_with: ClassVar[tuple[str, ...]] = ("link_inertia",)
    says = Beyond.READINGS

    def locations(self, state: State) -> tuple[str, ...]:
        """Sensors, and each of their axes."""
        names = tuple(state.readings)
        return names + tuple(f"{name}.{axis}" for name in names for axis in WRENCH_AXES)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Gain less one."""
        return (Parameter("gain_error", "1", 0.1, 1e-3),)

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Divide by the gain."""
        name, _, axis = location.partition(".")
        reading = state.readings[name].copy()
        reading[:, WRENCH_AXES.index(axis) if axis else slice(None)] /= 1.0 + theta[0]
        return state.replace(readings=state.readings | {name: reading})

    def report(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """The gain itself."""
        return {"gain": Estimate(1.0 + float(theta[0]), float(std[0]), "1")}
