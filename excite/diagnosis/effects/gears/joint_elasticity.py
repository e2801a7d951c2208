"""A soft gear between motor and link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Theta
from excite.diagnosis.effects.form import Draft, Form, Sizes
from excite.diagnosis.effects.gears.gear import Gear, contact_stiffness, gear_damping, link_inertia
from excite.diagnosis.effects.gears.gear_effect import GearEffect, joint_behind
from excite.diagnosis.effects.note import Beyond, Note
from excite.diagnosis.equations.joint_torque import Fit


@dataclass(frozen=True)
class Stretched(Note):
    """Where a soft gear begins a roll-out of which nothing is told.

    Attributes:
        stiffness: [N·m/rad].
        hardening_at: deflection at which it is twice as stiff as at rest [rad].
    """

    stiffness: float
    hardening_at: float | None = None

    beyond = Beyond.START
    every_step = False

    def deflection(self, torque: float) -> float:
        linear, at = -torque / self.stiffness, np.inf if self.hardening_at is None else self.hardening_at
        # x (1 + (x/x₀)²) = linear by Newton's method.
        x = linear
        for _ in range(30):
            r = x / at
            x -= (x * (1.0 + r * r) - linear) / (1.0 + 3.0 * r * r)
        return x


class JointElasticity(GearEffect):
    """The link's angle is the logged motor's angle plus a deflection, ``k δ = −τ`` (Spong 1987)."""

    name = "joint_elasticity"
    searched: ClassVar[tuple[Parameter, ...]] = (
        Parameter("stiffness", "N·m/rad", 0.01, 1e6),
        Parameter("damping_ratio", "1", 0.01, 2.0),
    )
    confusable_with = ("armature", "backlash", "time_delay")
    separating_motion = "a chirp of that joint around the resonance"
    mujoco = "a second joint with stiffness and damping behind the motor's"
    note = Stretched

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (HardeningElasticity(),)

    def grid(self, context: Context, location: str) -> list[Theta]:
        j = context.row(location)
        return [(contact_stiffness(context, j, hertz), 0.5) for hertz in (2.0, 3.0, 4.5, 6.5, 9.0, 13.0)]

    def gear(self, context: Context, location: str, theta: Theta) -> Gear:
        return Gear(theta[0], gear_damping(context, context.row(location), theta[0], theta[1]))

    def carried_over(self, old: Context, new: Context, location: str, theta: Theta) -> Theta:
        """As many swings a second: a link that turns out lighter has a gear that is softer by as much."""
        before, after = (float(link_inertia(c, c.row(location)).mean()) for c in (old, new))
        return (theta[0] * after / before, *theta[1:])

    def sizes(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, float]:
        values = super().sizes(context, location, theta, fit)
        damping = gear_damping(context, context.row(location), values["stiffness"], values["damping_ratio"])
        return values | {"damping": damping}

    def in_mujoco(self, item: Sizes) -> Form:
        def soft(draft: Draft) -> None:
            # MuJoCo's polynomial: force −(k₀ + k₁ |x| + k₂ x²) x.
            joint = joint_behind(draft, item.location)
            joint.stiffness = [item.value("stiffness"), 0.0, self.harder(item)]
            joint.damping = [item.value("damping"), 0.0, 0.0]

        return Form(elements=soft, notes=(self.noted(item),))

    def harder(self, item: Sizes) -> float:
        """Growth of the stiffness with the square of the deflection [N·m/rad³]."""
        return 0.0


class HardeningElasticity(JointElasticity):
    """A gear that grows stiffer: ``k δ (1 + (δ/δ₀)²)``, as harmonic drives do; where it is nearly slack, like play."""

    searched = (*JointElasticity.searched, Parameter("hardening_at", "rad", 1e-4, 1.0))

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        # Under a constant load the tangent is what has been found, and the spring at rest is softer.
        return [(s * theta[0], theta[1], at) for s in (0.15, 0.4, 0.8) for at in (0.01, 0.03, 0.08)]

    def own_starts(self, context: Context, location: str) -> list[Theta]:
        """Stiffer where the load stretches it than at rest: hardly damped, and damped more, whose valley is wider."""
        j = context.row(location)
        load = float(np.sqrt(np.mean(context.baseline.rigid[:, j] ** 2)))
        soft = [contact_stiffness(context, j, hertz) for hertz in (0.75, 1.1, 1.6, 2.4, 3.6, 5.4)]
        damped: list[Theta] = [(k, 0.3, 0.7 * load / k) for k in soft[:4]]
        return [*damped, *((k, 0.1, share * load / k) for k in soft[2:] for share in (0.7, 1.4))]

    def gear(self, context: Context, location: str, theta: Theta) -> Gear:
        return super().gear(context, location, theta)._replace(cubic=theta[2] ** -2)

    def harder(self, item: Sizes) -> float:
        return item.value("stiffness") / item.value("hardening_at") ** 2
