"""A sensor sits elsewhere than declared."""

from __future__ import annotations

from typing import ClassVar

import pinocchio as pin

from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter
from excite.diagnosis.floating.state import State
from excite.robot.robot import Array


class SensorFrameOffset(FloatingEffect):
    """True pose = declared · (translation, exp(rotation)).

    A shift alone and a turn alone are hypotheses of their own: what is mounted wrong is often one of them,
    and each is easier to tell from cross-talk and link lengths than both together.
    """

    name: ClassVar[str] = "sensor_frame_offset"
    reads_as: ClassVar[str] = "cross-talk between force axes; the last link's length for a foot sensor"

    def locations(self, state: State) -> tuple[str, ...]:
        """Sensors."""
        return tuple(state.readings)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Translation and rotation vector, in the declared frame."""
        shift = tuple(Parameter(axis, "m", 0.01, 1e-3) for axis in "xyz")
        return shift + tuple(Parameter(axis, "rad", 0.02, 1e-3) for axis in ("rx", "ry", "rz"))

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Move the sensor."""
        offset = pin.SE3(pin.exp3(theta[3:]), theta[:3])
        return state.but(placements=state.placements | {location: state.placements[location] * offset})
