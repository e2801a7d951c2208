"""A joint that bends under its load and is soft enough for what it carries to swing on it."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy.fft import dct, idct

from excite.arrays import Array
from excite.diagnosis.floating.effects.joint_elasticity import (
    MOST_ADDED,
    JointElasticity,
    leaning_of,
    loads_of,
)
from excite.diagnosis.floating.equations.state import State

# Steps of the parameters [rad/(N·m)]; a turn's acceleration by which inertia is measured [rad/s²].
_STEPS, _ACCELERATION = (1e-6, 1e-6), 1.0
# How near to what the spring holds back the inertia may come: noise is all that there is of a motion at resonance.
_NEAR_RESONANCE = 0.15


class SwingingJoint(JointElasticity):
    """True angle = logged − bend, with what the bend's own acceleration adds to the torque that bends the joint.

    Parameters as of :class:`JointElasticity`. The encoder sits before the spring (Spong 1987): what is behind it moves
    as the bend says, and resists with its inertia. Near the frequency at which it would swing on the joint a small
    motion of the encoder is a large one of it.
    """

    form: ClassVar[str] = "swinging_joint"

    def bend(self, state: State, joint: int, theta: Array) -> tuple[Array, Array]:
        """What a joint yields, ``(n,)`` [rad], and its derivative by each parameter, ``(n, 2)``."""
        at = loads_of(state, joint)
        torque, loads, softer = at.torque, at.by_parameter, at.per_torque
        if not theta.any():
            return np.zeros(len(torque)), -loads
        leaning, iv, a = leaning_of(state, joint), state.tree.idx_v[joint], state.a.copy()
        a[:, iv] += _ACCELERATION
        inertia = float((state.replace(a=a).smooth_torque(iv) - torque).mean()) / _ACCELERATION

        def bend(theta: Array) -> Array:
            compliance = softer @ theta
            held = 1.0 + np.maximum(compliance * leaning, -MOST_ADDED)
            ratio = inertia * float(compliance.mean()) / float(held.mean())
            return _swung(state, -(loads @ theta) / held, ratio)

        here = bend(theta)
        steps = np.diag(_STEPS)
        return here, np.column_stack([(bend(theta + step) - here) / step.sum() for step in steps])


def _swung(state: State, static: Array, ratio: float) -> Array:
    """``(n,)`` bend with inertia, ``b + ratio b'' = static``, smooth as motion is: no free oscillation is in it.

    Args:
        state: for its trials and rate.
        static: the bend without.
        ratio: of inertia to stiffness [s²].
    """
    out = np.empty_like(static)
    for span in state.record.spans:
        n = span.stop - span.start
        omega = np.pi * np.arange(n) * state.record.rate_hz / n
        left = 1.0 - ratio * omega**2
        follows = left * (1.0 + _NEAR_RESONANCE**2) / (left**2 + _NEAR_RESONANCE**2)
        # Cosines meet the ends of a trial without a jump.
        out[span] = idct(dct(static[span]) * follows)
    return out
