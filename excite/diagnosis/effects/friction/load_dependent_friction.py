"""Friction that grows with the load on the gear."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Form, Sizes
from excite.diagnosis.effects.note import Beyond, JointStep, Note


@dataclass(frozen=True)
class Loaded(Note):
    """Dry friction by the torque that the gear carries.

    Attributes:
        coefficient: [N·m/(N·m)].
    """

    coefficient: float

    beyond = Beyond.FRICTION

    @property
    def rubs(self) -> bool:
        return True

    def friction(self, level: float, at: JointStep) -> tuple[float, float]:
        return level + self.coefficient * abs(at.carried()), 0.0


class LoadDependentFriction(Effect):
    """``τ = α |τ_load| sign(v)`` with the predicted load (Hamon, Gautier, Garrec 2010, eq. 9)."""

    name = "load_dependent_friction"
    linear = (Parameter("coefficient", "N·m/(N·m)", 0.0),)
    confusable_with = ("coulomb_friction", "torque_gain", "time_delay")
    separating_motion = "the same motion with and without a known payload"
    mujoco = "none of its own: a control callback"
    friction = True
    by_load = True
    note = Loaded

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: (np.abs(context.baseline.rigid[:, j]) * context.sign(j))[:, None]})

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(notes=(self.noted(item),))
