"""Play in a gear: its equations of motion behind hard, bouncing, soft and round contacts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.effect import Belief, Effect, Parameter, Theta
from excite.diagnosis.effects.form import DEFLECTION, Absence, Context, Draft, Form, Note, Sizes
from excite.diagnosis.effects.gears.gear import Gear, contact_stiffness, gear_damping
from excite.diagnosis.effects.gears.gear_effect import GearEffect, joint_behind
from excite.diagnosis.equations.joint_torque import Fit
from excite.doctor.doubt import Doubt

if TYPE_CHECKING:
    import mujoco

# Soft play in MuJoCo's XML: contacts that come on over a width, as many hard ones one after the other.

_COUNT = 8
# Where the flanks add up to less than this share of the stiffness in the middle, there is none.
_LEAST_MIDDLE = 1e-3
# Impedances outside these MuJoCo replaces by them (mjMINIMP, mjMAXIMP).
_IMPEDANCE = (1e-4, 0.9999)


@dataclass(frozen=True)
class SoftPlay:
    """Two contacts, each of torque ``k s log(1 + exp((x − g)/s))`` on its side.

    Attributes:
        half: half the play, g [rad].
        softness: width over which contact comes on, s [rad].
        stiffness: of a contact that is wholly on, k [N·m/rad].
        damping: of the same [N·m·s/rad].
    """

    half: float
    softness: float
    stiffness: float
    damping: float

    @property
    def middle_stiffness_share(self) -> float:
        """Share of the stiffness that the two flanks add up to at x = 0."""
        return 1.0 - float(np.tanh(0.5 * self.half / self.softness))

    def resting_deflection(self, torque: float) -> float:
        """Where it rests under a torque [N·m] that it opposes [rad]."""
        y = abs(torque) / self.stiffness / self.softness
        ratio = self.half / self.softness
        if y > 300.0:
            return float(np.sign(torque)) * self.softness * (y + ratio)
        # exp(y) = (1 + u e)/(1 + e/u) with u = exp(x/s), e = exp(−g/s) is quadratic in u.
        beyond, e = np.expm1(y), np.exp(-ratio)
        u = (beyond + np.sqrt(beyond**2 + 4.0 * (1.0 + beyond) * e**2)) / (2.0 * e)
        return float(np.sign(torque) * self.softness * np.log(u))

    def hard_contacts(self, count: int) -> Array:
        """Distances from the middle of hard contacts that share what is not the middle's alike, ``(count,)`` [rad].

        The softplus is the mean of hard contacts that lie around its own place with the logistic distribution.
        That is cut into parts of equal weight, each of which has its contact where its mean is: far out the torque
        is the soft contacts' own.
        """
        ratio = self.half / self.softness
        left = (1.0 - self.middle_stiffness_share) * (1.0 - np.arange(1, count) / count)
        # Slope 1 − sinh(g/s)/(cosh(x/s) + cosh(g/s)).
        x = np.arccosh(np.maximum(np.sinh(ratio) / left - np.cosh(ratio), 1.0))
        held = np.logaddexp(0.0, x - ratio) - np.logaddexp(0.0, -x - ratio)
        moment = np.concatenate([[0.0], x * (1.0 - left) - held, [ratio]])
        return np.asarray(self.softness * np.diff(moment) * count / (1.0 - self.middle_stiffness_share))


def add_soft_play(spec: mujoco.MjSpec, joint: str, play: SoftPlay) -> None:
    """Hold a joint between soft contacts: limits of tendons that hang on it alone, and an equality for the middle.

    MuJoCo's constraints act as ``f = D (−b ẋ − k x − ẍ)`` with ``D`` from their impedance. With
    ``D = h² K + h B``, ``k = K/D`` and ``b = (B + h K)/D`` that is a spring K and a damper B of an implicit step h:
    stable however stiff they are, and gone where the contact is open.

    Args:
        spec: the specification, with all its bodies and joints.
        play: its contacts.
    """
    import mujoco

    compiled = spec.compile()
    mobility = float(compiled.dof_invweight0[compiled.joint(joint).dofadr[0]])
    step = float(spec.option.timestep)
    share = (1.0 - play.middle_stiffness_share) / _COUNT
    solref, solimp = _contact_parameters(share * play.stiffness, share * play.damping, mobility, step)
    for number, distance in enumerate(play.hard_contacts(_COUNT)):
        tendon = spec.add_tendon(name=f"{joint}.contact.{number}", limited=True)
        tendon.range = [-distance, distance]
        tendon.solref_limit, tendon.solimp_limit = solref, solimp
        tendon.wrap_joint(joint, 1.0)
    if play.middle_stiffness_share > _LEAST_MIDDLE:
        middle = spec.add_equality(name=f"{joint}.middle", type=mujoco.mjtEq.mjEQ_JOINT, name1=joint)
        middle.objtype = mujoco.mjtObj.mjOBJ_JOINT
        middle.data[:5] = 0.0
        middle.solref, middle.solimp = _contact_parameters(
            play.middle_stiffness_share * play.stiffness,
            play.middle_stiffness_share * play.damping,
            mobility,
            step,
        )


def _contact_parameters(
    stiffness: float, damping: float, mobility: float, step: float
) -> tuple[list[float], list[float]]:
    """``solref`` and ``solimp`` of a constraint that is a spring and a damper."""
    low, high = (d / (1.0 - d) / mobility for d in _IMPEDANCE)
    weight = min(max(step**2 * stiffness + step * damping, low), high)
    d = weight * mobility / (1.0 + weight * mobility)
    # MuJoCo divides both by the impedance.
    k, b = d * stiffness / weight, d * (damping + step * stiffness) / weight
    return [-k, -b], [d, d, 0.001, 0.5, 2.0]


# Share of the widest play that a search has to end below.
_SETTLED = 0.9


@dataclass(frozen=True)
class BacklashNote(Note):
    """Where a loose gear begins a roll-out of which nothing is told: at one end of its play.

    Attributes:
        width: of the play [rad].
        softness: width over which contact comes on [rad].
        stiffness: of such a contact [N·m/rad].
    """

    width: float
    softness: float | None = None
    stiffness: float | None = None

    beyond = Absence.START
    every_step = False

    def resting_deflection(self, torque: float) -> float:
        if self.softness is not None and self.stiffness is not None:
            return -SoftPlay(0.5 * self.width, self.softness, self.stiffness, 0.0).resting_deflection(torque)
        return float(-0.5 * np.sign(torque) * self.width)


class Backlash(GearEffect):
    """The link flies freely through a dead band between two contacts (Nordin, Gutman 2002, section 2)."""

    name = "backlash"
    belief = Belief(group="gear")
    observed_by = frozenset({Doubt.DELAY})
    searched: ClassVar[tuple[Parameter, ...]] = (
        Parameter("width", "rad", 2e-4, 0.08),
        Parameter("contact_hz", "Hz", 4.0, 150.0),
    )
    confusable_with = ("torque_bias", "stribeck", "joint_elasticity")
    separating_motion = "torque crossing zero at constant speed"
    mujoco = "a second joint with limited range behind the motor's"
    note = BacklashNote

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return (DampedBacklash(), SoftBacklash(), RoundBacklash())

    def search_grid(self, context: Context, location: str) -> list[Theta]:
        return [(w, 20.0) for w in (0.002, 0.004, 0.007, 0.011, 0.016, 0.024, 0.036)]

    def make_gear(self, context: Context, location: str, theta: Theta) -> Gear:
        return self._between_contacts(context, location, theta[0], theta[1], 1.0)

    def is_within_scope(self, context: Context, location: str, theta: Theta, fit: Fit) -> bool:
        """Play as wide as any that is searched is a soft gear that passes for it."""
        return theta[0] < _SETTLED * self.searched[0].high

    def in_mujoco(self, item: Sizes) -> Form:
        def add_play_joint(draft: Draft) -> None:
            # Its range is as wide as the play; its stops have the contact's frequency and damping.
            joint = joint_behind(draft, item.location)
            half = 0.5 * item.value_of("width")
            joint.limited, joint.range = True, [-half, half]
            ratio = item.value_of("damping_ratio", 1.0)
            joint.solref_limit = [1.0 / (2.0 * np.pi * item.value_of("contact_hz", 20.0) * ratio), ratio]
            joint.solimp_limit = [0.99, 0.99, 0.001, 0.5, 2.0]

        return Form(elements=add_play_joint, notes=(self.make_note(item),))

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
    def extended_forms(self) -> tuple[Effect, ...]:
        return ()

    def search_starts(self, theta: Theta) -> list[Theta]:
        return [(theta[0], theta[1], 1.0), (theta[0], 2.0 * theta[1], 2.0), (theta[0], theta[1], 0.5)]

    def make_gear(self, context: Context, location: str, theta: Theta) -> Gear:
        return self._between_contacts(context, location, theta[0], theta[1], theta[2])


class SoftBacklash(Backlash):
    """Contacts that come on over a width instead of at once; in the middle they add up to a little stiffness."""

    searched = (*Backlash.searched, Parameter("softness", "rad", 2e-4, 0.02))

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return ()

    def search_starts(self, theta: Theta) -> list[Theta]:
        # Where contacts are soft, play that was found with hard ones is too narrow.
        return [(w, theta[1], 0.15 * w) for w in (theta[0], 3.0 * theta[0], 0.03)]

    def make_gear(self, context: Context, location: str, theta: Theta) -> Gear:
        return super().make_gear(context, location, theta)._replace(soft=theta[2])

    def to_sizes(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, float]:
        values, j = super().to_sizes(context, location, theta, fit), context.row(location)
        stiffness = contact_stiffness(context, j, values["contact_hz"])
        return values | {"stiffness": stiffness, "damping": gear_damping(context, j, stiffness, 1.0)}

    def in_mujoco(self, item: Sizes) -> Form:
        def add_free_joint(draft: Draft) -> None:
            joint_behind(draft, item.location)

        def add_soft_contacts(draft: Draft) -> None:
            of_contact = (item.value_of(name) for name in ("softness", "stiffness", "damping"))
            play = SoftPlay(0.5 * item.value_of("width"), *of_contact)
            add_soft_play(draft.spec, item.location + DEFLECTION, play)

        return Form(elements=add_free_joint, finish=add_soft_contacts, notes=(self.make_note(item),))


class RoundBacklash(Backlash):
    """Round contacts, the stiffer the more they carry: ``contact_hz`` is told at the mean load."""

    searched = (
        Backlash.searched[0],
        Parameter("contact_hz", "Hz", 1.0, 150.0),
        Parameter("damping_ratio", "1", 0.05, 4.0),
    )

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return ()

    def search_starts(self, theta: Theta) -> list[Theta]:
        return [(w, f, 0.3) for w in (0.7 * theta[0], theta[0]) for f in (2.0, 4.0, 8.0)]

    def make_gear(self, context: Context, location: str, theta: Theta) -> Gear:
        found = self._between_contacts(context, location, theta[0], theta[1], theta[2])
        load = float(np.abs(context.baseline.rigid[:, context.row(location)]).mean())
        return found._replace(depth=load / found.stiffness)
