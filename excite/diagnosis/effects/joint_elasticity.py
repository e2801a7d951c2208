"""A soft gear between motor and link."""

from __future__ import annotations

from typing import ClassVar

from excite.diagnosis.effects.backlash import Backlash
from excite.diagnosis.effects.deflection import link_inertia, response
from excite.diagnosis.effects.effect import Context, Effect, Parameter, Shape, Theta


class JointElasticity(Effect):
    """The link's angle is the logged motor's angle plus a deflection, ``k δ = −τ`` (Spong 1987)."""

    name = "joint_elasticity"
    searched: ClassVar[tuple[Parameter, ...]] = (
        Parameter("stiffness", "N·m/rad", 0.01, 1e6),
        Parameter("damping_ratio", "1", 0.01, 2.0),
    )
    confusable_with = ("armature", "backlash", "time_delay")
    separating_motion = "a chirp of that joint around the resonance"
    mujoco = "a second joint with stiffness and damping behind the motor's"
    moves = True
    smooths = True

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (HardeningElasticity(),)

    def grid(self, context: Context, location: str) -> list[Theta]:
        j = context.row(location)
        inertia = float(link_inertia(context, j).mean())
        resonances = (2.0, 3.0, 4.5, 6.5, 9.0, 13.0)
        return [(inertia * (6.283 * f) ** 2, 0.5) for f in resonances]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        return Shape(offset=response(context, context.row(location), theta[0], theta[1], 0.0))


class HardeningElasticity(JointElasticity):
    """A gear that grows stiffer: ``k δ (1 + (δ/δ₀)²)``, as harmonic drives do; where it is nearly slack, like play."""

    searched = (*JointElasticity.searched, Parameter("hardening_at", "rad", 1e-4, 1.0))

    @property
    def kin(self) -> tuple[Effect, ...]:
        return (Backlash(),)

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        # Under a constant load the tangent is what has been found, and the spring at rest is softer.
        return [(s * theta[0], theta[1], at) for s in (0.15, 0.4, 0.8) for at in (0.01, 0.03, 0.08)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        cubic = theta[2] ** -2
        return Shape(offset=response(context, context.row(location), theta[0], theta[1], 0.0, cubic))
