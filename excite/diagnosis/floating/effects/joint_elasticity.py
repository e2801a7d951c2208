"""A joint bends under its load."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.diagnosis.candidate import Estimate
from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, joint_of, joints
from excite.diagnosis.floating.joint_turns import joint_turn
from excite.diagnosis.floating.state import State
from excite.robot.robot import Array


class JointElasticity(FloatingEffect):
    """True angle = logged − compliance × torque; the torque includes what the feet carry."""

    name: ClassVar[str] = "joint_elasticity"
    reads_as: ClassVar[str] = "encoder offset, where the joint's load hardly changes"
    least_shrink: ClassVar[float] = 0.15

    def locations(self, state: State) -> tuple[str, ...]:
        """Joints."""
        return joints(state)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Compliance, one over the stiffness."""
        return (Parameter("compliance", "rad/(N·m)", 3e-3, 1e-4),)

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Bend the joint, with the rates that this brings."""
        joint = joint_of(state, location)
        iq, iv = state.tree.idx_q[joint], state.tree.idx_v[joint]
        bend, rate, rate_of_rate = (theta[0] * change for change in self._yields(state, iv))
        q, v, a = state.q.copy(), state.v.copy(), state.a.copy()
        q[:, iq] += bend
        v[:, iv] += rate
        a[:, iv] += rate_of_rate
        return state.but(q=q, v=v, a=a)

    def columns(self, state: State, location: str, theta: Array) -> Array:
        """The joint's columns along what a unit of compliance lets it yield."""
        joint = joint_of(state, location)
        bent = self.apply(state, location, theta) if theta.any() else state
        q, v, a = (change[:, None] for change in self._yields(state, state.tree.idx_v[joint]))
        return joint_turn(bent, joint).columns(q, v, a)

    def _yields(self, state: State, iv: int) -> tuple[Array, Array, Array]:
        """Angle, velocity and acceleration for a unit of compliance, ``(n,)``."""
        bend = -state.smooth_torques[:, iv]
        rate, again = np.empty_like(bend), np.empty_like(bend)
        for span in state.record.spans:
            rate[span] = np.gradient(bend[span], 1.0 / state.record.rate_hz)
            again[span] = np.gradient(rate[span], 1.0 / state.record.rate_hz)
        return bend, rate, again

    def report(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """Stiffness and compliance."""
        if not theta[0]:
            return super().report(state, location, theta, std)
        stiffness = 1.0 / float(theta[0])
        spread = abs(stiffness * float(std[0] / theta[0]))
        return {
            "stiffness": Estimate(stiffness, spread, "N·m/rad"),
            **super().report(state, location, theta, std),
        }
