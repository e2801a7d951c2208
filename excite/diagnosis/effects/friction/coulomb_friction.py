"""Coulomb friction: a torque against the velocity whatever its size."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Form, Sizes
from excite.diagnosis.effects.friction.build_up import PRESLIDING, BuildUp
from excite.diagnosis.effects.friction.presliding import hysteretic_sign
from excite.diagnosis.effects.gears.backlash import Backlash
from excite.diagnosis.effects.note import Noted
from excite.diagnosis.equations.dry_friction.friction_sign import WIDTHS, SignChange, of_velocity
from excite.diagnosis.equations.dry_friction.play import behind_play
from excite.diagnosis.equations.own_columns import COULOMB

# Rigid bodies' share of an axis' torque (root mean square) below which it carries no mass to speak of: less than 1e-5
# on a friction damper whose moving parts are not part of the record.
_MASSLESS = 0.02
# A sign that changes over more than this share of a joint's speed (root mean square) is a slope: viscous friction.
_SIGN = 0.25


class CoulombFriction(Effect):
    """``τ = f_c sign(v)``, the sign smoothed over a width that is searched (Armstrong-Hélouvry et al. 1994)."""

    name = "coulomb_friction"
    linear = (Parameter("level", "N·m", 0.0),)
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("width", "rad/s", 5e-4, 0.1),)
    confusable_with = ("stribeck", "load_dependent_friction", "viscous_friction")
    separating_motion = "slow reversals at constant speed"
    mujoco = "joint frictionloss"
    term = COULOMB

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (CoulombBristles(), CoulombBehindPlay())

    @property
    def forms(self) -> tuple[Effect, ...]:
        return (CoulombBristles(),)

    def grid(self, context: Context, location: str) -> list[Theta]:
        return [(w,) for w in WIDTHS]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        sign = SignChange(theta[0], straight=context.baseline.signs[j].straight)
        return Shape({j: of_velocity(context.v[:, [j]], sign)})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        speed = float(np.sqrt(np.mean(context.v[:, context.row(location)] ** 2)))
        narrow = theta[0] <= max(_SIGN * speed, WIDTHS[0])
        return narrow and super().admissible(context, location, theta, beta)

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(coulomb=item.value("level"))


class CoulombBristles(CoulombFriction):
    """Coulomb friction that builds up over a deflection."""

    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("breakaway", "rad", 1e-4, 2e-2),)

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (CoulombBehindPlay(),)

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


class CoulombBehindPlay(CoulombBristles):
    """The same behind play, on an axis that carries no mass: after a reversal nothing resists until it is used up.

    A link that has mass flies through its play, which is a gear's law and not this one.
    """

    searched: ClassVar[tuple[Parameter, ...]] = (
        *CoulombBristles.searched,
        Parameter("width", "rad", 2e-4, 0.08),
    )
    along: ClassVar[dict[type[Effect], tuple[str, ...]]] = {Backlash: ("width",)}

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        return [(d, w) for d in (5e-4, 1.5e-3) for w in (1.5e-3, 3e-3, 6e-3)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j, samples = context.row(location), context.baseline.samples
        way = np.diff(context.q[:, j], prepend=0.0)
        return Shape({j: behind_play(way, samples.starts, theta[1], theta[0])[:, None]})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        return _massless(context, context.row(location)) and super().admissible(
            context, location, theta, beta
        )


def _massless(context: Context, j: int) -> bool:
    """Whether a joint's rigid bodies ask for next to nothing of its torque."""
    base = context.baseline
    torque = base.samples.stacked("tau")[:, j]
    return bool(np.mean(base.rigid[:, j] ** 2) <= _MASSLESS**2 * np.mean(torque**2))
