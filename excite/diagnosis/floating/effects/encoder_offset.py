"""A joint's encoder is off by a constant."""

from __future__ import annotations

from typing import ClassVar

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, joint_of, joints
from excite.diagnosis.floating.effects.form import Beyond
from excite.diagnosis.floating.equations.joint_turns import joint_turn
from excite.diagnosis.floating.equations.state import State
from excite.doctor.doubt import Doubt


class EncoderOffset(FloatingEffect):
    """True position = logged + offset."""

    name: ClassVar[str] = "encoder_offset"
    told_by = frozenset({Doubt.POSITION, Doubt.GRAVITY})
    reads_as: ClassVar[str] = (
        "link length and inertia beyond the joint; postures that turn it against gravity"
    )
    confusable_with: ClassVar[tuple[str, ...]] = ("link_length_error", "link_inertia")
    says = Beyond.MOTION

    def locations(self, state: State) -> tuple[str, ...]:
        """Joints."""
        return joints(state)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The offset, true less logged."""
        return (Parameter("offset", "rad", 0.05, 1e-3),)

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Turn the joint."""
        q = state.q.copy()
        q[:, state.tree.idx_q[joint_of(state, location)]] += theta[0]
        return state.replace(q=q)

    def columns(self, state: State, location: str, theta: Array) -> Array:
        """The joint's own column: it turns, and no more."""
        turned = self.apply(state, location, theta) if theta.any() else state
        return -joint_turn(turned, joint_of(state, location)).by_q(state.readings)[:, :, None]

    def report(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """Logged less true, as the contract counts it."""
        return super().report(state, location, -theta, std)
