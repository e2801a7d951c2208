"""One channel of a sensor leaks into another."""

from __future__ import annotations

from typing import ClassVar

from excite.arrays import Array
from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter
from excite.diagnosis.floating.effects.form import Beyond
from excite.diagnosis.floating.equations.state import State
from excite.logs.columns import WRENCH_AXES


class SensorCrosstalk(FloatingEffect):
    """Logged B = true B + c · true A, at ``SENSOR.A->B``."""

    name: ClassVar[str] = "sensor_crosstalk"
    reads_as: ClassVar[str] = "a turn of the sensor's frame, which couples A to B and B to A"
    confusable_with: ClassVar[tuple[str, ...]] = ("sensor_frame_offset",)
    says = Beyond.READINGS

    def locations(self, state: State) -> tuple[str, ...]:
        """Every ordered pair of axes of every sensor."""
        return tuple(
            f"{name}.{source}->{target}"
            for name in state.readings
            for source in WRENCH_AXES
            for target in WRENCH_AXES
            if source != target
        )

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The coefficient."""
        source, target = location.partition(".")[2].split("->")
        if source[0] == target[0]:
            return (Parameter("coefficient", "1", 0.05, 1e-3),)
        return (
            Parameter("coefficient", "m", 0.03, 1e-3)
            if source[0] == "f"
            else Parameter("coefficient", "1/m", 0.3, 1e-2),
        )

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Subtract the leak; the source's channel is right as logged."""
        name, _, pair = location.partition(".")
        source, target = (WRENCH_AXES.index(axis) for axis in pair.split("->"))
        reading = state.readings[name].copy()
        reading[:, target] -= theta[0] * reading[:, source]
        return state.replace(readings=state.readings | {name: reading})
