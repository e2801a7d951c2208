"""A spring at a joint: cable, hose, gravity compensator."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.bristle import Bristle
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.forces.one_sided import OneSided
from excite.diagnosis.effects.form import Draft, Form, Sizes
from excite.diagnosis.effects.friction.presliding import hysteretic_sign
from excite.diagnosis.effects.note import Beyond, JointStep, Note
from excite.doctor.doubt import Doubt

# A spring whose torque hardly changes over the joint's motion is a constant.
_CHANGES = 0.05
# Cables and springs wind up over no more than so many radians.
_TRAVEL = 4.0 * np.pi
# A length that no joint reaches, where a spring is slack [rad].
_FAR = 1e3


@dataclass(frozen=True)
class Spring(Note):
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

    beyond = Beyond.SPRING

    @property
    def rubs(self) -> bool:
        return self.breakaway is not None

    def bristle(self) -> Bristle | None:
        return None if self.breakaway is None else Bristle(self.breakaway)

    def held(self, level: Array) -> Array:
        return np.full_like(level, self.rubbing or 0.0)

    def torque(self, at: JointStep) -> Array:
        return np.asarray(-(self.quadratic * at.q**2 + self.cubic * at.q**3))


class JointSpring(Effect):
    """``τ = k q + τ_0``: stiffness and the torque at zero position."""

    name = "joint_spring"
    told_by = frozenset({Doubt.POSITION, Doubt.GRAVITY})
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter("stiffness", "N·m/rad"),
        Parameter("torque_at_zero", "N·m", beside=True),
    )
    confusable_with = ("torque_bias", "encoder_offset", "base_tilt")
    separating_motion = "the joint slowly over its whole range, in two postures of the others"
    mujoco = "joint stiffness and springref; with slack, a tendon of that joint alone"
    by_motion = True
    note = Spring
    spans: ClassVar[tuple[str, ...]] = ("q", "1")

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (HardeningSpring(), RubbingSpring())

    @property
    def forms(self) -> tuple[Effect, ...]:
        return (SlackSpring(), LowerSlackSpring())

    def locations(self, context: Context) -> tuple[str, ...]:
        return tuple(j for j, q in zip(context.joints, context.q.T, strict=True) if np.ptp(q) <= _TRAVEL)

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        q = context.q[:, j]
        return Shape({j: np.column_stack([q, np.ones_like(q)])})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        q = context.q[:, context.row(location)]
        constant = abs(beta[0] * q.mean() + beta[1])
        changes = abs(beta[0]) * q.std() >= _CHANGES * constant
        return changes and pulls_back(q, beta[0]) and super().admissible(context, location, theta, beta)

    def in_mujoco(self, item: Sizes) -> Form:
        stiffness = item.value("stiffness")

        def stretched(draft: Draft) -> None:
            joint = draft.joint(item.location)
            joint.stiffness = [stiffness, 0.0, 0.0]
            joint.springref = -item.value("torque_at_zero") / stiffness

        return Form(elements=stretched)


class SlackSpring(OneSided, JointSpring):
    """``τ = k max(q − edge, 0)`` over much of a joint's travel: a hose that tightens, a weight that lifts off."""

    first: ClassVar[tuple[float, ...]] = (0.5, 0.65, 0.8)
    # What acts over less is a stop, over more a spring without slack.
    within: ClassVar[tuple[float, float]] = (0.45, 0.95)
    spans: ClassVar[tuple[str, ...]] = ()
    patches = True

    @property
    def forms(self) -> tuple[Effect, ...]:
        return ()

    def in_mujoco(self, item: Sizes) -> Form:
        edge, stiffness = item.value("edge"), item.value("stiffness")
        slack = [-_FAR, edge] if self.side > 0.0 else [edge, _FAR]

        def tightened(draft: Draft) -> None:
            tendon = draft.spec.add_tendon(
                name=f"{item.location}.spring", stiffness=[stiffness, 0.0, 0.0], springlength=slack
            )
            tendon.wrap_joint(item.location, 1.0)

        return Form(elements=tightened)


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
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        return [()]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        q = context.q[:, j]
        return Shape({j: np.column_stack([q, np.ones_like(q), q**2, q**3])})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        stiffness, _, quadratic, cubic = beta[:4]
        return pulls_back(context.q[:, context.row(location)], stiffness, quadratic, cubic)

    def in_mujoco(self, item: Sizes) -> Form:
        return replace(super().in_mujoco(item), notes=(self.noted(item),))


class RubbingSpring(HardeningSpring):
    """The same with a dry rubbing that builds up over a deflection."""

    by_motion = False
    linear = (*HardeningSpring.linear, Parameter("rubbing", "N·m", beside=True))
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("breakaway", "rad", 1e-3, 0.3),)

    def starts(self, theta: Theta) -> list[Theta]:
        return [(0.02,), (0.08,)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        columns = super().shape(context, location, theta).columns[j]
        return Shape({j: np.column_stack([columns, hysteretic_sign(context, j, theta[0])])})

    def in_mujoco(self, item: Sizes) -> Form:
        rubbing = item.value("rubbing")
        if rubbing > 0.0:
            return super().in_mujoco(item)
        # Bristles do not push: where a fit has them do so, the joint has less dry friction.
        rest = {name: value for name, value in item.values.items() if name not in ("rubbing", "breakaway")}
        return replace(super().in_mujoco(replace(item, values=rest)), coulomb=rubbing)


def pulls_back(q: Array, stiffness: float, quadratic: float = 0.0, cubic: float = 0.0) -> bool:
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
