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
    """True angle = logged − (compliance + stiffening · |τ|/τ₀) · τ, the torque τ with what the feet carry.

    τ₀ is the largest torque of the record. Gears with flexsplines and rubber stiffen under load
    (Tuttle and Seering 1996); a straight line is the case without it.
    """

    name: ClassVar[str] = "joint_elasticity"
    reads_as: ClassVar[str] = "encoder offset, where the joint's load hardly changes"
    least_shrink: ClassVar[float] = 0.15

    def locations(self, state: State) -> tuple[str, ...]:
        """Joints."""
        return joints(state)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Compliance of the unloaded joint, one over its stiffness, and how that changes with load."""
        return (
            Parameter("compliance", "rad/(N·m)", 3e-3, 1e-4),
            Parameter("stiffening", "rad/(N·m)", 1e-3, 1e-4),
        )

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Bend the joint, with the rates that this brings."""
        joint = joint_of(state, location)
        iq, iv = state.tree.idx_q[joint], state.tree.idx_v[joint]
        bend, rate, rate_of_rate = (change @ theta for change in self._yields(state, iv))
        q, v, a = state.q.copy(), state.v.copy(), state.a.copy()
        q[:, iq] += bend
        v[:, iv] += rate
        a[:, iv] += rate_of_rate
        return state.but(q=q, v=v, a=a)

    def columns(self, state: State, location: str, theta: Array) -> Array:
        """The joint's columns along what each parameter lets it yield."""
        joint = joint_of(state, location)
        bent = self.apply(state, location, theta) if theta.any() else state
        return joint_turn(bent, joint).columns(*self._yields(state, state.tree.idx_v[joint]))

    def _yields(self, state: State, iv: int) -> tuple[Array, Array, Array]:
        """Angle, velocity and acceleration for a unit of each parameter, ``(n, 2)``."""
        torque = state.smooth_torques[:, iv]
        load = np.abs(torque) / max(float(np.abs(torque).max()), 1e-9)
        bend = -np.column_stack([torque, load * torque])
        rate, again = np.empty_like(bend), np.empty_like(bend)
        for span in state.record.spans:
            rate[span] = np.gradient(bend[span], 1.0 / state.record.rate_hz, axis=0)
            again[span] = np.gradient(rate[span], 1.0 / state.record.rate_hz, axis=0)
        return bend, rate, again

    def report(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """Stiffness of the unloaded joint, and the parameters."""
        if not theta[0]:
            return super().report(state, location, theta, std)
        stiffness = 1.0 / float(theta[0])
        spread = abs(stiffness * float(std[0] / theta[0]))
        return {
            "stiffness": Estimate(stiffness, spread, "N·m/rad"),
            **super().report(state, location, theta, std),
        }
