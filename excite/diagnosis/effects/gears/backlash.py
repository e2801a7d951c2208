"""Play in a gear: its equations of motion behind hard, bouncing, soft and round contacts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Theta
from excite.diagnosis.effects.form import DEFLECTION, Draft, Form, Sizes
from excite.diagnosis.effects.gears.gear import Gear, contact_stiffness, gear_damping
from excite.diagnosis.effects.gears.gear_effect import GearEffect, joint_behind
from excite.diagnosis.effects.gears.soft_play import SoftPlay, add_soft_play
from excite.diagnosis.effects.note import Beyond, Note
from excite.diagnosis.equations.joint_torque import Fit
from excite.doctor.doubt import Doubt

# Share of the widest play that a search has to end below.
_SETTLED = 0.9


@dataclass(frozen=True)
class Play(Note):
    """Where a loose gear begins a roll-out of which nothing is told: at one end of its play.

    Attributes:
        width: of the play [rad].
        softness: width over which contact comes on [rad].
        stiffness: of such a contact [N·m/rad].
    """

    width: float
    softness: float | None = None
    stiffness: float | None = None

    beyond = Beyond.START
    every_step = False

    def deflection(self, torque: float) -> float:
        if self.softness is not None and self.stiffness is not None:
            return -SoftPlay(0.5 * self.width, self.softness, self.stiffness, 0.0).deflection(torque)
        return float(-0.5 * np.sign(torque) * self.width)


class Backlash(GearEffect):
    """The link flies freely through a dead band between two contacts (Nordin, Gutman 2002, section 2)."""

    name = "backlash"
    told_by = frozenset({Doubt.DELAY})
    searched: ClassVar[tuple[Parameter, ...]] = (
        Parameter("width", "rad", 2e-4, 0.08),
        Parameter("contact_hz", "Hz", 4.0, 150.0),
    )
    confusable_with = ("torque_bias", "stribeck", "joint_elasticity")
    separating_motion = "torque crossing zero at constant speed"
    mujoco = "a second joint with limited range behind the motor's"
    note = Play

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (DampedBacklash(), SoftBacklash(), RoundBacklash())

    def grid(self, context: Context, location: str) -> list[Theta]:
        return [(w, 20.0) for w in (0.002, 0.004, 0.007, 0.011, 0.016, 0.024, 0.036)]

    def gear(self, context: Context, location: str, theta: Theta) -> Gear:
        return self._between_contacts(context, location, theta[0], theta[1], 1.0)

    def settled(self, context: Context, location: str, theta: Theta, fit: Fit) -> bool:
        """Play as wide as any that is searched is a soft gear that passes for it."""
        return theta[0] < _SETTLED * self.searched[0].high

    def in_mujoco(self, item: Sizes) -> Form:
        def loose(draft: Draft) -> None:
            # Its range is as wide as the play; its stops have the contact's frequency and damping.
            joint = joint_behind(draft, item.location)
            half = 0.5 * item.value("width")
            joint.limited, joint.range = True, [-half, half]
            ratio = item.value("damping_ratio", 1.0)
            joint.solref_limit = [1.0 / (2.0 * np.pi * item.value("contact_hz", 20.0) * ratio), ratio]
            joint.solimp_limit = [0.99, 0.99, 0.001, 0.5, 2.0]

        return Form(elements=loose, notes=(self.noted(item),))

    def _between_contacts(
        self, context: Context, location: str, width: float, hertz: float, ratio: float
    ) -> Gear:
        j = context.row(location)
        stiffness = contact_stiffness(context, j, hertz)
        return Gear(stiffness, gear_damping(context, j, stiffness, ratio), 0.5 * width)


class DampedBacklash(Backlash):
    """The same with contacts that bounce, or that are slow to let go."""

    searched = (*Backlash.searched, Parameter("damping_ratio", "1", 0.1, 4.0))

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        return [(theta[0], theta[1], 1.0), (theta[0], 2.0 * theta[1], 2.0), (theta[0], theta[1], 0.5)]

    def gear(self, context: Context, location: str, theta: Theta) -> Gear:
        return self._between_contacts(context, location, theta[0], theta[1], theta[2])


class SoftBacklash(Backlash):
    """Contacts that come on over a width instead of at once; in the middle they add up to a little stiffness."""

    searched = (*Backlash.searched, Parameter("softness", "rad", 2e-4, 0.02))

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        # Where contacts are soft, play that was found with hard ones is too narrow.
        return [(w, theta[1], 0.15 * w) for w in (theta[0], 3.0 * theta[0], 0.03)]

    def gear(self, context: Context, location: str, theta: Theta) -> Gear:
        return super().gear(context, location, theta)._replace(soft=theta[2])

    def sizes(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, float]:
        values, j = super().sizes(context, location, theta, fit), context.row(location)
        stiffness = contact_stiffness(context, j, values["contact_hz"])
        return values | {"stiffness": stiffness, "damping": gear_damping(context, j, stiffness, 1.0)}

    def in_mujoco(self, item: Sizes) -> Form:
        def free(draft: Draft) -> None:
            joint_behind(draft, item.location)

        def held(draft: Draft) -> None:
            of_contact = (item.value(name) for name in ("softness", "stiffness", "damping"))
            play = SoftPlay(0.5 * item.value("width"), *of_contact)
            add_soft_play(draft.spec, item.location + DEFLECTION, play)

        return Form(elements=free, finish=held, notes=(self.noted(item),))


class RoundBacklash(Backlash):
    """Round contacts, the stiffer the more they carry: ``contact_hz`` is told at the mean load."""

    searched = (
        Backlash.searched[0],
        Parameter("contact_hz", "Hz", 1.0, 150.0),
        Parameter("damping_ratio", "1", 0.05, 4.0),
    )

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        return [(w, f, 0.3) for w in (0.7 * theta[0], theta[0]) for f in (2.0, 4.0, 8.0)]

    def gear(self, context: Context, location: str, theta: Theta) -> Gear:
        found = self._between_contacts(context, location, theta[0], theta[1], theta[2])
        load = float(np.abs(context.baseline.rigid[:, context.row(location)]).mean())
        return found._replace(depth=load / found.stiffness)
