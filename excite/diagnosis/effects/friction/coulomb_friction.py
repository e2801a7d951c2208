"""Coulomb friction: a torque against the velocity whatever its size."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Form, Sizes
from excite.diagnosis.effects.friction.build_up import PRESLIDING, BuildUp
from excite.diagnosis.effects.friction.presliding import hysteretic_sign
from excite.diagnosis.effects.note import Noted
from excite.diagnosis.equations.friction_sign import WIDTHS
from excite.diagnosis.equations.own_columns import COULOMB

# A sign that changes over more than this share of a joint's speed (root mean square) is a slope: viscous friction.
_SIGN = 0.25


class CoulombFriction(Effect):
    """``τ = f_c sign(v)``, the sign smoothed over a width that is searched (Armstrong-Hélouvry et al. 1994)."""

    name = "coulomb_friction"
    linear = (Parameter("level", "N·m", 0.0),)
    searched = (Parameter("width", "rad/s", 5e-4, 0.1),)
    confusable_with = ("stribeck", "load_dependent_friction", "viscous_friction")
    separating_motion = "slow reversals at constant speed"
    mujoco = "joint frictionloss"
    term = COULOMB

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (CoulombBristles(),)

    @property
    def forms(self) -> tuple[Effect, ...]:
        return (CoulombBristles(),)

    def grid(self, context: Context, location: str) -> list[Theta]:
        return [(w,) for w in WIDTHS]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: np.tanh(context.v[:, [j]] / theta[0])})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        speed = float(np.sqrt(np.mean(context.v[:, context.row(location)] ** 2)))
        narrow = theta[0] <= max(_SIGN * speed, WIDTHS[0])
        return narrow and super().admissible(context, location, theta, beta)

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(coulomb=item.value("level"))


class CoulombBristles(CoulombFriction):
    """Coulomb friction that builds up over a deflection."""

    searched = (Parameter("breakaway", "rad", 1e-4, 2e-2),)

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    @property
    def forms(self) -> tuple[Effect, ...]:
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        return [(5e-4,), (2e-3,), (5e-3,)]

    def grid(self, context: Context, location: str) -> list[Theta]:
        return self.starts(())

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        return Effect.admissible(self, context, location, theta, beta)

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: hysteretic_sign(context, j, theta[0])[:, None]})

    def in_mujoco(self, item: Sizes) -> Form:
        bends = BuildUp(item.value("breakaway"))
        return Form(coulomb=item.value("level"), notes=(Noted(PRESLIDING, item.location, bends),))
