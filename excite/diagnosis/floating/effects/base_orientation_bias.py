"""The logged orientation of the base is off by a constant rotation."""

from __future__ import annotations

from typing import ClassVar

import pinocchio as pin

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter
from excite.diagnosis.floating.effects.form import Beyond
from excite.diagnosis.floating.equations.state import State
from excite.doctor.doubt import Doubt


class BaseOrientationBias(FloatingEffect):
    """True orientation = logged · exp(rotation), the rotation in the base frame.

    With foot sensors a tilt of gravity in the base frame (``base_tilt``) is the same thing.
    """

    name: ClassVar[str] = "base_orientation_bias"
    told_by = frozenset({Doubt.POSITION, Doubt.GRAVITY})
    reads_as: ClassVar[str] = "constant horizontal sensor bias or external force; bending forward and turning"
    confusable_with: ClassVar[tuple[str, ...]] = ("sensor_bias", "external_force")
    says = Beyond.MOTION

    def locations(self, state: State) -> tuple[str, ...]:
        """The base."""
        return ("base",)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Rotation vector."""
        return tuple(Parameter(axis, "rad", 0.03, 1e-3) for axis in ("rx", "ry", "rz"))

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Turn the base; its rates, logged in the base frame, turn back."""
        turn = pin.exp3(theta)
        x, y, z, w = pin.Quaternion(turn).coeffs()
        q, v, a = state.q.copy(), state.v.copy(), state.a.copy()
        a0, a1, a2, a3 = q[:, 3].copy(), q[:, 4].copy(), q[:, 5].copy(), q[:, 6].copy()
        q[:, 3] = a3 * x + a0 * w + a1 * z - a2 * y
        q[:, 4] = a3 * y - a0 * z + a1 * w + a2 * x
        q[:, 5] = a3 * z + a0 * y - a1 * x + a2 * w
        q[:, 6] = a3 * w - a0 * x - a1 * y - a2 * z
        for first in (0, 3):
            v[:, first : first + 3] = v[:, first : first + 3] @ turn
            a[:, first : first + 3] = a[:, first : first + 3] @ turn
        return state.replace(q=q, v=v, a=a)

    def report(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """Logged against true."""
        return super().report(state, location, -theta, std)
