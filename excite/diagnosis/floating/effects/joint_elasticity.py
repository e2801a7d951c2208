"""A joint bends under its load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, joint_of, joints
from excite.diagnosis.floating.effects.form import Beyond
from excite.diagnosis.floating.equations.joint_turns import joint_turn
from excite.diagnosis.floating.equations.state import State

# A turn by which the torque's change is measured [rad], and the most that bending may add to itself: beyond one it
# would buckle.
_TURN, MOST_ADDED = 1e-3, 0.8


class JointElasticity(FloatingEffect):
    """True angle = logged − (compliance + stiffening · |τ|/τ₀) · τ, the bent joint's τ with what the feet carry.

    τ₀ is the largest torque of the record. Gears with flexsplines and rubber stiffen under load
    (Tuttle and Seering 1996); a straight line is the case without it.
    """

    name: ClassVar[str] = "joint_elasticity"
    reads_as: ClassVar[str] = "encoder offset, where the joint's load hardly changes"
    confusable_with: ClassVar[tuple[str, ...]] = ("encoder_offset",)
    leaves: ClassVar[tuple[str, ...]] = ("encoder_offset",)
    says = Beyond.MOTION
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
        if not theta.any():
            return state
        joint = joint_of(state, location)
        bend = self.bend(state, joint, theta)[0]
        iq, iv, rate = state.tree.idx_q[joint], state.tree.idx_v[joint], _rates(state, bend)
        q, v, a = state.q.copy(), state.v.copy(), state.a.copy()
        q[:, iq] += bend
        v[:, iv] += rate
        a[:, iv] += _rates(state, rate)
        return state.replace(q=q, v=v, a=a)

    def columns(self, state: State, location: str, theta: Array) -> Array:
        """The joint's columns along what each parameter lets it yield."""
        joint = joint_of(state, location)
        yields = self.bend(state, joint, theta)[1]
        rates = _rates(state, yields)
        bent = self.apply(state, location, theta)
        return joint_turn(bent, joint).columns(state.readings, yields, rates, _rates(state, rates))

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

    def bend(self, state: State, joint: int, theta: Array) -> tuple[Array, Array]:
        """What a joint yields, ``(n,)`` [rad], and its derivative by each parameter, ``(n, 2)``.

        A bent joint leans further, which changes its torque: to first order by what a turn of the joint alone makes
        of it. Rates are left out, since they would bring noise of accelerations into the torque a second time.
        """
        at = loads_of(state, joint)
        torque, loads, softer = at.torque, at.by_parameter, at.per_torque
        if not theta.any():
            return np.zeros(len(torque)), -loads
        adds = -leaning_of(state, joint)[:, None] * softer
        more = 1.0 / (1.0 - np.minimum(adds @ theta, MOST_ADDED))
        bend = more * (-loads @ theta)
        return bend, more[:, None] * (bend[:, None] * adds - loads)


@dataclass(frozen=True, eq=False)
class Loads:
    """What makes a joint yield.

    Attributes:
        torque: that it carries, ``(n,)`` [N·m].
        by_parameter: what each parameter makes it yield by, ``(n, 2)``.
        per_torque: the change of that with the torque, ``(n, 2)``.
    """

    torque: Array
    by_parameter: Array
    per_torque: Array


def loads_of(state: State, joint: int) -> Loads:
    """The loads of a joint, by its index in the tree."""
    torque = state.smooth_torques[:, state.tree.idx_v[joint]]
    ratio = np.abs(torque) / max(float(np.abs(torque).max()), 1e-9)
    return Loads(
        torque,
        np.column_stack([torque, ratio * torque]),
        np.column_stack([np.ones_like(ratio), 2.0 * ratio]),
    )


def leaning_of(state: State, joint: int) -> Array:
    """``(n,)`` change of a joint's torque by its own turn [N·m/rad]."""
    iv, q = state.tree.idx_v[joint], state.q.copy()
    q[:, state.tree.idx_q[joint]] += _TURN
    return (state.replace(q=q).smooth_torque(iv) - state.smooth_torques[:, iv]) / _TURN


def _rates(state: State, values: Array) -> Array:
    """Derivative with respect to time within each trial, ``(n, …)``."""
    spans, rate = state.record.spans, state.record.rate_hz
    return np.concatenate([np.gradient(values[span], 1.0 / rate, axis=0) for span in spans])
