"""A sensor sits elsewhere than declared."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter
from excite.diagnosis.floating.effects.form import Part
from excite.diagnosis.floating.equations.state import State


class SensorFrameOffset(FloatingEffect):
    """True pose = declared · (translation, exp(rotation))."""

    name: ClassVar[str] = "sensor_frame_offset"
    reads_as: ClassVar[str] = "cross-talk between force axes; the last link's length for a foot sensor"
    confusable_with: ClassVar[tuple[str, ...]] = ("sensor_crosstalk", "link_length_error")
    says = Part.SENSORS
    mujoco: ClassVar[str] = "pos and quat of the site that is the sensor"

    def locations(self, state: State) -> tuple[str, ...]:
        """Sensors."""
        return tuple(state.readings)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Translation and rotation vector, in the declared frame."""
        shift = tuple(Parameter(axis, "m", 0.01, 1e-3) for axis in "xyz")
        return shift + tuple(Parameter(axis, "rad", 0.02, 1e-3) for axis in ("rx", "ry", "rz"))

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Move the sensor."""
        moved = state.placements[location] * _offset(theta)
        return state.replace(placements=state.placements | {location: moved})

    def columns(self, state: State, location: str, theta: Array) -> Array:
        """What it makes of the reading in the declared frame, by finite differences; the lever is the same."""
        here, turned = _offset(theta).toDualActionMatrix(), []
        for i, parameter in enumerate(self.parameters(state, location)):
            ahead = theta.copy()
            ahead[i] += parameter.step
            turned.append((_offset(ahead).toDualActionMatrix() - here) / parameter.step)
        changes = np.einsum("kij,nj->nik", turned, state.readings[location])
        return -state.levers[location] @ changes


def _offset(theta: Array) -> pin.SE3:
    return pin.SE3(pin.exp3(theta[3:]), theta[:3])
