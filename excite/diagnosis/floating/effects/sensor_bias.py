"""A sensor reads a constant that is not there."""

from __future__ import annotations

from typing import ClassVar

from excite.arrays import Array
from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter
from excite.diagnosis.floating.effects.form import Beyond
from excite.diagnosis.floating.equations.state import State
from excite.logs.columns import WRENCH_AXES


class SensorBias(FloatingEffect):
    """Logged = true + bias, all six axes."""

    name: ClassVar[str] = "sensor_bias"
    reads_as: ClassVar[str] = "constant external force, inertials, base orientation; the unloaded foot tells"
    confusable_with: ClassVar[tuple[str, ...]] = ("external_force", "link_inertia", "base_orientation_bias")
    says = Beyond.READINGS

    def locations(self, state: State) -> tuple[str, ...]:
        """Sensors."""
        return tuple(state.readings)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The bias of each axis."""
        return tuple(
            Parameter(axis, "N" if axis[0] == "f" else "N·m", 15.0 if axis[0] == "f" else 3.0, 1.0)
            for axis in WRENCH_AXES
        )

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Subtract it."""
        return state.replace(readings=state.readings | {location: state.readings[location] - theta})
