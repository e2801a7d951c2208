"""Effects of forces that depend on the joint's position: springs, ripple."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.bristle import Bristle
from excite.diagnosis.effects.effect import Effect, Parameter, Theta
from excite.diagnosis.effects.form import Absence, Context, Draft, Form, JointStep, Note, Sizes
from excite.diagnosis.effects.friction import hysteretic_sign
from excite.diagnosis.equations.joint_torque import Fit
from excite.doctor.doubt import Doubt

# What pushes a joint back beyond an edge and does nothing before it: a stop, or a spring with slack.


class OneSided(Effect):
    """``τ = k max(q − edge, 0)``; the search is over how far the joint goes beyond the edge.

    Attributes:
        side: 1 where it acts above the edge, −1 below.
        first: shares of the joint's travel beyond the edge from which the search begins.
        within: least and greatest share that its name stands for. What acts over much of the travel is a spring: edges
            at 75 to 85 % of the samples leave 0.15 to 0.46 of the travel of 56 joints beyond them (95 % of the joints),
            edges at half of the samples 0.42 to 0.58.
    """

    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("stiffness", "N·m/rad", 0.0),)
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("depth", "rad", 1e-3, 12.0),)
    by_motion = True
    side: ClassVar[float] = 1.0
    first: ClassVar[tuple[float, ...]] = ()
    within: ClassVar[tuple[float, float]] = (0.0, 1.0)

    def search_grid(self, context: Context, location: str) -> list[Theta]:
        travel = float(np.ptp(context.signal_at(location, "q")))
        return [(share * travel,) for share in self.first]

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        way = self.side * context.signal_at(location, "q")
        return self.side * np.maximum(way - (way.max() - theta[0]), 0.0)[:, None]

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        travel = float(np.ptp(context.signal_at(location, "q")))
        least, most = self.within
        return (
            self.searched[0].low <= theta[0]
            and least * travel <= theta[0] <= most * travel
            and beta[0] >= 0.0
        )

    def other_side(self, context: Context, location: str, theta: Theta) -> Theta:
        """Non-linear parameters of what acts on the other side of the same edge."""
        return (float(np.ptp(context.signal_at(location, "q"))) - theta[0],)

    def to_estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        way = self.side * context.signal_at(location, "q")
        stiffness = super().to_estimates(context, location, theta, fit)["stiffness"]
        return {
            "edge": Estimate(self.side * (float(way.max()) - theta[0]), None, "rad"),
            "stiffness": stiffness,
        }


# A spring at a joint: cable, hose, gravity compensator.

# A spring whose torque hardly changes over the joint's motion is a constant.
_CHANGES = 0.05
# Cables and springs wind up over no more than so many radians.
_TRAVEL = 4.0 * np.pi
# A length that no joint reaches, where a spring is slack [rad].
_FAR = 1e3


@dataclass(frozen=True)
class SpringNote(Note):
    """What a spring has beside its stiffness.

    Attributes:
        quadratic: [N·m/rad²].
        cubic: [N·m/rad³].
        rubbing: dry friction that builds up over a deflection [N·m].
        breakaway: that deflection [rad].
    """

    quadratic: float
    cubic: float
    rubbing: float | None = None
    breakaway: float | None = None

    beyond = Absence.SPRING

    @property
    def has_friction(self) -> bool:
        return self.breakaway is not None

    def make_bristle(self) -> Bristle | None:
        return None if self.breakaway is None else Bristle(self.breakaway)

    def held_friction(self, level: Array) -> Array:
        return np.full_like(level, self.rubbing or 0.0)

    def joint_torque(self, at: JointStep) -> Array:
        return np.asarray(-(self.quadratic * at.q**2 + self.cubic * at.q**3))


class JointSpring(Effect):
    """``τ = k q + τ_0``: stiffness and the torque at zero position."""

    name = "joint_spring"
    observed_by = frozenset({Doubt.POSITION, Doubt.GRAVITY})
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter("stiffness", "N·m/rad"),
        Parameter("torque_at_zero", "N·m", beside=True),
    )
    confusable_with = ("torque_bias", "encoder_offset", "base_tilt")
    separating_motion = "the joint slowly over its whole range, in two postures of the others"
    mujoco = "joint stiffness and springref; with slack, a tendon of that joint alone"
    by_motion = True
    note = SpringNote
    spans: ClassVar[tuple[str, ...]] = ("q", "1")
    behind = True

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return (HardeningSpring(), RubbingSpring())

    @property
    def variant_forms(self) -> tuple[Effect, ...]:
        return (SlackSpring(), LowerSlackSpring())

    def locations(self, context: Context) -> tuple[str, ...]:
        return tuple(j for j, q in zip(context.joints, context.q.T, strict=True) if np.ptp(q) <= _TRAVEL)

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        q = context.signal_at(location, "q")
        return np.column_stack([q, np.ones_like(q)])

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        q = context.signal_at(location, "q")
        constant = abs(beta[0] * q.mean() + beta[1])
        changes = abs(beta[0]) * q.std() >= _CHANGES * constant
        return changes and is_restoring(q, beta[0]) and super().is_admissible(context, location, theta, beta)

    def in_mujoco(self, item: Sizes) -> Form:
        stiffness = item.value_of("stiffness")

        def add_spring(draft: Draft) -> None:
            joint = draft.find_joint(item.location)
            joint.stiffness = [stiffness, 0.0, 0.0]
            joint.springref = -item.value_of("torque_at_zero") / stiffness

        return Form(elements=add_spring)


class SlackSpring(OneSided, JointSpring):
    """``τ = k max(q − edge, 0)`` over much of a joint's travel: a hose that tightens, a weight that lifts off."""

    first: ClassVar[tuple[float, ...]] = (0.5, 0.65, 0.8)
    # What acts over less is a stop, over more a spring without slack.
    within: ClassVar[tuple[float, float]] = (0.45, 0.95)
    spans: ClassVar[tuple[str, ...]] = ()

    @property
    def variant_forms(self) -> tuple[Effect, ...]:
        return ()

    def in_mujoco(self, item: Sizes) -> Form:
        edge, stiffness = item.value_of("edge"), item.value_of("stiffness")
        slack = [-_FAR, edge] if self.side > 0.0 else [edge, _FAR]

        def add_tendon_spring(draft: Draft) -> None:
            tendon = draft.spec.add_tendon(
                name=f"{item.location}.spring", stiffness=[stiffness, 0.0, 0.0], springlength=slack
            )
            tendon.wrap_joint(item.location, 1.0)

        return Form(elements=add_tendon_spring)


class LowerSlackSpring(SlackSpring):
    """The same below an edge."""

    side: ClassVar[float] = -1.0


class HardeningSpring(JointSpring):
    """``τ = k q + τ_0 + k₂ q² + k₃ q³``: a spring that grows stiffer with its stretch."""

    linear: ClassVar[tuple[Parameter, ...]] = (
        *JointSpring.linear,
        Parameter("quadratic", "N·m/rad²", beside=True),
        Parameter("cubic", "N·m/rad³", beside=True),
    )

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return ()

    def search_starts(self, theta: Theta) -> list[Theta]:
        return [()]

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        q = context.signal_at(location, "q")
        return np.column_stack([q, np.ones_like(q), q**2, q**3])

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        stiffness, _, quadratic, cubic = beta[:4]
        return is_restoring(context.signal_at(location, "q"), stiffness, quadratic, cubic)

    def in_mujoco(self, item: Sizes) -> Form:
        return replace(super().in_mujoco(item), notes=(self.make_note(item),))


class RubbingSpring(HardeningSpring):
    """The same with a dry rubbing that builds up over a deflection."""

    by_motion = False
    linear = (*HardeningSpring.linear, Parameter("rubbing", "N·m", beside=True))
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("breakaway", "rad", 1e-3, 0.3),)

    def search_starts(self, theta: Theta) -> list[Theta]:
        return [(0.02,), (0.08,)]

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        columns = super().unit_torques(context, location, theta)
        return np.column_stack([columns, hysteretic_sign(context, location, theta[0])])

    def in_mujoco(self, item: Sizes) -> Form:
        rubbing = item.value_of("rubbing")
        if rubbing > 0.0:
            return super().in_mujoco(item)
        # Bristles do not push: where a fit has them do so, the joint has less dry friction.
        rest = {name: value for name, value in item.values.items() if name not in ("rubbing", "breakaway")}
        return replace(super().in_mujoco(replace(item, values=rest)), coulomb=rubbing)


def is_restoring(q: Array, stiffness: float, quadratic: float = 0.0, cubic: float = 0.0) -> bool:
    """Whether a spring holds against the motion as a whole, as what winds up does; no simulator has another.

    A polynomial that gives way curves through what a body, or a constant that differs from run to run, leaves: of
    friction at an arm's second joint it made 52 N·m/rad at zero, −1 N·m/rad over the positions that were there.

    Args:
        q: ``(n_samples,)`` positions [rad].
        stiffness: [N·m/rad].
        quadratic: [N·m/rad²].
        cubic: [N·m/rad³].
    """
    return float((q - q.mean()) @ (q * (stiffness + q * (quadratic + q * cubic)))) > 0.0


# A stop that a joint runs into, or a body that the arm touches there: physics that no name of a diagnosis
# has.


class EndStop(OneSided):
    """``τ = k max(q − edge, 0)`` over a small part of a joint's travel."""

    name = "end_stop"
    nameless = "position"
    first: ClassVar[tuple[float, ...]] = (0.05, 0.12, 0.22, 0.35)
    within: ClassVar[tuple[float, float]] = (0.0, 0.45)

    @property
    def variant_forms(self) -> tuple[Effect, ...]:
        return (LowerEndStop(),)

    def equivalent_form(self, context: Context, location: str, theta: Theta) -> tuple[Effect, Theta]:
        """A spring that is slack where this pushes: weight and a constant take up what grows with the position."""
        other = LowerSlackSpring() if self.side > 0.0 else SlackSpring()
        return other, self.other_side(context, location, theta)


class LowerEndStop(EndStop):
    """The same at the other end of the travel."""

    side: ClassVar[float] = -1.0

    @property
    def variant_forms(self) -> tuple[Effect, ...]:
        return ()


# Torque ripple and cogging: a torque periodic in the joint's position.

# Periods over a joint's motion below which nothing has been seen to repeat: a spring or a stop would do as well.
_SEEN = 2.0
# Spacing of the periods a revolution that are tried, and the most of them: strain-wave gears have two waves a turn of
# the motor, 200 to 320 a turn of the joint at the usual ratios of 100 to 160.
_APART, _MOST = 0.5, 340.0


@dataclass(frozen=True)
class RippleNote(Note):
    """A torque periodic in a joint's position, with its second harmonic and the part that grows with the load.

    Attributes:
        cosine: [N·m]; sine alike.
        periods_per_rev: periods a revolution.
        cosine_2: of the second harmonic [N·m]; sine_2 alike.
        cosine_load: by the torque that the gear carries [N·m/(N·m)]; sine_load alike.
    """

    cosine: float
    sine: float
    periods_per_rev: float
    cosine_2: float | None = None
    sine_2: float | None = None
    cosine_load: float | None = None
    sine_load: float | None = None

    beyond = Absence.SPRING

    def joint_torque(self, at: JointStep) -> Array:
        phase = self.periods_per_rev * at.q
        c, s = np.cos(phase), np.sin(phase)
        wave = self.cosine * c + self.sine * s
        if self.cosine_2 is not None and self.sine_2 is not None:
            wave = wave + self.cosine_2 * np.cos(2.0 * phase) + self.sine_2 * np.sin(2.0 * phase)
        if self.cosine_load is not None and self.sine_load is not None:
            wave = wave + np.abs(at.carried()) * (self.cosine_load * c + self.sine_load * s)
        return np.asarray(-wave)


class TorqueRipple(Effect):
    """``τ = A cos(N q) + B sin(N q)`` with N periods a revolution."""

    name = "torque_ripple"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("cosine", "N·m"), Parameter("sine", "N·m"))
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("periods_per_rev", "1", 4.0, 1.2 * _MOST),)
    confusable_with = ("joint_spring",)
    separating_motion = "a slow sweep of the joint at constant speed"
    mujoco = "none of its own: a control callback"
    by_motion = True
    note = RippleNote

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return (RippleHarmonics(),)

    def search_grid(self, context: Context, location: str) -> list[Theta]:
        """The three best of those seen to repeat, by a projection of the baseline's residual at the rows."""
        j = context.row(location)
        samples = context.baseline.samples
        q = np.concatenate(
            [p[t.rows] for p, t in zip(samples.by_trial(context.q[:, j]), samples.trials, strict=True)]
        )
        use = samples.identification_rows
        # Every second row: the sampling of the phase matters little, that of the periods much.
        residual, q = context.baseline.fit.residual[j][use][::2], q[use][::2]
        least = _SEEN * 2.0 * np.pi / max(float(np.ptp(context.q[:, j])), 1e-9)
        periods = np.arange(max(4.0, np.ceil(2.0 * least) / 2.0), _MOST, _APART)
        power = _project_on_waves(periods, q, residual)
        best: list[Theta] = []
        for k in np.argsort(-power):
            if all(abs(periods[k] - b[0]) > 1.5 for b in best):
                best.append((float(periods[k]),))
            if len(best) == 3:
                break
        return best

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        phase = theta[0] * context.signal_at(location, "q")
        return np.column_stack([np.cos(phase), np.sin(phase)])

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        seen = theta[0] * float(np.ptp(context.signal_at(location, "q"))) / (2.0 * np.pi)
        return seen >= _SEEN and super().is_admissible(context, location, theta, beta)

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(notes=(self.make_note(item),))


def _project_on_waves(periods: Array, q: Array, residual: Array) -> Array:
    """``|Σ r exp(−i N q)|`` at evenly spaced N, ``(n_periods,)``; each wave is the one before, turned on."""
    power = np.empty(len(periods))
    if len(periods) == 0:
        return power
    wave, turn = residual * np.exp(-1j * periods[0] * q), np.exp(-1j * _APART * q)
    for k in range(len(periods)):
        power[k] = np.abs(wave.sum())
        wave *= turn
    return power


class RippleHarmonics(TorqueRipple):
    """The same with a second harmonic, and an amplitude that grows with the load on the gear."""

    by_motion = False
    linear = (
        *TorqueRipple.linear,
        *(Parameter(name, "N·m") for name in ("cosine_2", "sine_2")),
        *(Parameter(name, "N·m/(N·m)") for name in ("cosine_load", "sine_load")),
    )

    @property
    def extended_forms(self) -> tuple[Effect, ...]:
        return ()

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        load = np.abs(context.baseline.rigid[:, [context.row(location)]])
        waves = super().unit_torques(context, location, theta)
        return np.hstack([waves, super().unit_torques(context, location, (2.0 * theta[0],)), load * waves])
