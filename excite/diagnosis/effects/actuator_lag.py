"""Actuators that follow their command with a lag."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.effects.effect import Context, Effect, Parameter, Shape, Theta
from excite.robot.robot import Array

# Less than this share of a sample is a matter of when within it a logger reads its channels.
_SAMPLE = 0.4


class ActuatorLag(Effect):
    """The log holds the command u, the joints get τ with ``T τ̇ + τ = u``: ``u = τ + T τ̇``, linear in T."""

    name = "actuator_lag"
    linear = (Parameter("time_constant", "s", 0.0, 0.5),)
    confusable_with = ("time_delay", "viscous_friction")
    separating_motion = "a chirp to 5 … 15 Hz"
    mujoco = "actuator dyntype filter, dynprm"
    timing = True

    def locations(self, context: Context) -> tuple[str, ...]:
        return ("torque",)

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        samples = context.baseline.samples
        parts = [np.gradient(t, axis=0) * samples.rate_hz for t in samples.split(context.baseline.total)]
        column = np.concatenate(parts)
        return Shape({j: column[:, [j]] for j in range(column.shape[1])})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        least = _SAMPLE / context.baseline.samples.rate_hz
        return beta[0] >= least and super().admissible(context, location, theta, beta)
