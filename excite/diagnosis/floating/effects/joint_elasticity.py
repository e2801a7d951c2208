"""A joint bends under its load."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, joint_of, joints
from excite.diagnosis.floating.state import State
from excite.logs.signals.butterworth import lowpass
from excite.robot.robot import Array

_CUTOFF_HZ = 4.0


class JointElasticity(FloatingEffect):
    """True angle = logged − compliance × torque; the torque includes what the feet carry."""

    name: ClassVar[str] = "joint_elasticity"
    reads_as: ClassVar[str] = "encoder offset, where the joint's load hardly changes"

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
        bend = -theta[0] * state.joint_torques[:, iv]
        q, v, a = state.q.copy(), state.v.copy(), state.a.copy()
        for span in state.record.spans:
            # The torque's own noise would be differentiated twice.
            bend[span] = lowpass(bend[span], state.record.rate_hz, _CUTOFF_HZ)
            rate = np.gradient(bend[span], 1.0 / state.record.rate_hz)
            v[span, iv] += rate
            a[span, iv] += np.gradient(rate, 1.0 / state.record.rate_hz)
        q[:, iq] += bend
        return state.but(q=q, v=v, a=a)
