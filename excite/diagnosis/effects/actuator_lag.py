"""Actuators that follow their command with a lag."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.effects.effect import Context, Effect, Parameter, Shape, Theta


class ActuatorLag(Effect):
    """The log holds the command u, the joints get τ with ``T τ̇ + τ = u``: ``u = τ + T τ̇``, linear in T."""

    name = "actuator_lag"
    linear = (Parameter("time_constant", "s", 0.0, 0.5),)
    confusable_with = ("time_delay", "viscous_friction")
    separating_motion = "a chirp to 5 … 15 Hz"
    mujoco = "actuator dyntype filter, dynprm"

    def locations(self, context: Context) -> tuple[str, ...]:
        return ("torque",)

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        samples = context.baseline.samples
        parts = [np.gradient(t, axis=0) * samples.rate_hz for t in samples.split(context.baseline.total)]
        column = np.concatenate(parts)
        return Shape({j: column[:, [j]] for j in range(column.shape[1])})
