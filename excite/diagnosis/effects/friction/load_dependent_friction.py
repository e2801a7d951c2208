"""Friction that grows with the load on the gear."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Form, Sizes
from excite.diagnosis.effects.note import Beyond, JointStep, Note
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.own_columns import coulomb_level

# The share of the load that friction itself adds is the coefficient; it may be this many times that, no more: else a
# torque scale would pass for it.
_OWN = 2.0
# Correlation with the load below which nothing grows with it: rounding errors would be fitted.
_GROWS = 1e-3


@dataclass(frozen=True)
class Loaded(Note):
    """Dry friction by the torque that the gear carries.

    Attributes:
        coefficient: [N·m/(N·m)].
        exponent: of the load; one where it is None.
        power_scale: what the power of the load is multiplied by to be a torque [(N·m)^(1 − exponent)].
        own_share: share of the motor's torque that is friction again; None where the link's load counts.
    """

    coefficient: float
    exponent: float | None = None
    power_scale: float | None = None
    own_share: float | None = None

    beyond = Beyond.FRICTION

    @property
    def rubs(self) -> bool:
        return True

    def friction(self, level: Array, at: JointStep) -> tuple[Array, float]:
        load = at.carried()
        if self.own_share is not None:
            load = motor_torque(load, np.sign(at.v), level, self.own_share)
        if self.exponent is None or self.power_scale is None:
            return level + self.coefficient * np.abs(load), 0.0
        return level + self.coefficient * self.power_scale * np.abs(load) ** self.exponent, 0.0


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

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (CurvedLoadFriction(), MotorLoadFriction())

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: (np.abs(context.baseline.rigid[:, j]) * context.sign(j))[:, None]})

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(notes=(self.noted(item),))


class CurvedLoadFriction(LoadDependentFriction):
    """``τ = α k |τ_load|^p sign(v)``: teeth that touch over more of their flanks, the more they carry.

    The scale k makes α the slope of the straight line that comes nearest, as that of friction in proportion is.
    """

    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("exponent", "1", 0.4, 1.6),)

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        return [(0.8,), (1.2,)]

    def load(self, context: Context, location: str, theta: Theta) -> Array:
        """The load that counts, ``(n_samples,)`` [N·m]."""
        return context.baseline.rigid[:, context.row(location)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        load = self._scale(context, location, theta) * self._power(context, location, theta)
        return Shape({j: (load * context.sign(j))[:, None]})

    def sizes(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, float]:
        scale = {"power_scale": self._scale(context, location, theta)}
        return super().sizes(context, location, theta, fit) | scale

    def _power(self, context: Context, location: str, theta: Theta) -> Array:
        return np.asarray(np.abs(self.load(context, location, theta)) ** theta[0])

    def _scale(self, context: Context, location: str, theta: Theta) -> float:
        load = np.abs(context.baseline.rigid[:, context.row(location)])
        power = self._power(context, location, theta)
        along = load - load.mean()
        slope = float(along @ power) / max(float(along @ along), 1e-300)
        # What hardly grows with the load has no such line.
        return 1.0 / slope if slope * along.std() > _GROWS * power.std() else 0.0


class MotorLoadFriction(CurvedLoadFriction):
    """The same of the torque that the motor gives, friction and all: more while it drives than while it holds back.

    With ``τ = τ_load + (F + α τ_motor) sign(v)`` friction is a share of itself as well.
    """

    searched = (*CurvedLoadFriction.searched, Parameter("own_share", "1", 0.01, 0.6))

    def starts(self, theta: Theta) -> list[Theta]:
        return [(0.8, 0.1), (1.2, 0.1), (1.0, 0.2)]

    def load(self, context: Context, location: str, theta: Theta) -> Array:
        j, base = context.row(location), context.baseline
        level = coulomb_level(base.modelled, base.fit.own[j])
        return motor_torque(base.rigid[:, j], context.sign(j), level, theta[1])

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        return theta[1] <= _OWN * beta[0] and super().admissible(context, location, theta, beta)


def motor_torque(load: Array, sign: Array, level: Array | float, share: float) -> Array:
    """Torque of a motor whose friction is a level and a share of that torque itself, like ``load`` [N·m]."""
    along = load * sign + np.maximum(level, 0.0)
    return np.asarray(np.abs(along) / np.where(along > 0.0, 1.0 - share, 1.0 + share))
