"""A spring at a joint: cable, hose, gravity compensator."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.bristle import Bristle
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Draft, Form, Sizes
from excite.diagnosis.effects.friction.presliding import hysteretic_sign
from excite.diagnosis.effects.note import Beyond, JointStep, Note, Noted
from excite.diagnosis.equations.joint_torque import Fit
from excite.doctor.doubt import Doubt

# A spring whose torque hardly changes over the joint's motion is a constant.
_CHANGES = 0.05
# Share of a motion's time from which what pushes back beyond an edge is a spring that is slack before it: drawn arms
# run into stops for 15 to 25 % of it, another simulator's springs of one side pull for half. And least time of slack.
_OFTEN, _LEAST_SLACK = 0.3, 0.1
# Shares of a motion for which a spring of one side is slack where its search begins.
_SLACK = (0.2, 0.35, 0.5, 0.65)
# Cables and springs wind up over no more than so many radians.
_TRAVEL = 4.0 * np.pi


@dataclass(frozen=True)
class Spring(Note):
    """What a spring has beside its stiffness.

    Attributes:
        quadratic: [N·m/rad²].
        cubic: [N·m/rad³].
        rubbing: dry friction that builds up over a deflection [N·m].
        breakaway: that deflection [rad].
        taut: stiffness of a spring that is slack on one side [N·m/rad].
        above: where that pulls above a position [rad].
        below: where it pulls below one [rad].
    """

    quadratic: float = 0.0
    cubic: float = 0.0
    rubbing: float | None = None
    breakaway: float | None = None
    taut: float | None = None
    above: float | None = None
    below: float | None = None

    beyond = Beyond.SPRING

    @property
    def rubs(self) -> bool:
        return self.breakaway is not None

    def bristle(self) -> Bristle | None:
        return None if self.breakaway is None else Bristle(self.breakaway)

    def held(self, level: float) -> float:
        return self.rubbing or 0.0

    def torque(self, at: JointStep) -> float:
        pulled = self.quadratic * at.q**2 + self.cubic * at.q**3
        if self.taut is not None and self.above is not None:
            pulled += self.taut * max(at.q - self.above, 0.0)
        if self.taut is not None and self.below is not None:
            pulled += self.taut * min(at.q - self.below, 0.0)
        return -pulled


class JointSpring(Effect):
    """``τ = k q + τ_0``: stiffness and the torque at zero position."""

    name = "joint_spring"
    told_by = frozenset({Doubt.POSITION, Doubt.GRAVITY})
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter("stiffness", "N·m/rad"),
        Parameter("torque_at_zero", "N·m"),
    )
    confusable_with = ("torque_bias", "encoder_offset", "base_tilt")
    separating_motion = "the joint slowly over its whole range, in two postures of the others"
    mujoco = "joint stiffness and springref"
    note = Spring
    spans = ("q", "1")

    @property
    def forms(self) -> tuple[Effect, ...]:
        return (SlackSpring(1.0), SlackSpring(-1.0))

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (HardeningSpring(), RubbingSpring())

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


class HardeningSpring(JointSpring):
    """``τ = k q + τ_0 + k₂ q² + k₃ q³``: a spring that grows stiffer with its stretch."""

    linear: ClassVar[tuple[Parameter, ...]] = (
        *JointSpring.linear,
        Parameter("quadratic", "N·m/rad²"),
        Parameter("cubic", "N·m/rad³"),
    )

    @property
    def forms(self) -> tuple[Effect, ...]:
        return ()

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

    linear = (*HardeningSpring.linear, Parameter("rubbing", "N·m"))
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


class SlackSpring(JointSpring):
    """``τ = k max(q − q_0, 0)``, or the same below: a cable, a bungee or a hose that is slack on one side.

    The search is over how far the joint goes beyond where it is taut.

    Args:
        side: 1 where it pulls above a position, −1 where it pulls below one.
    """

    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("stiffness", "N·m/rad", 0.0),)
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("depth", "rad", 1e-3, 6.0),)

    def __init__(self, side: float):
        self.side = side

    @property
    def forms(self) -> tuple[Effect, ...]:
        return ()

    def grid(self, context: Context, location: str) -> list[Theta]:
        way = self.side * context.q[:, context.row(location)]
        most = float(way.max())
        return [(most - float(np.quantile(way, slack)),) for slack in _SLACK]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        way = self.side * context.q[:, j]
        return Shape({j: self.side * np.maximum(way - (way.max() - theta[0]), 0.0)[:, None]})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        return beta[0] >= 0.0 and pulls_often(self.side * context.q[:, context.row(location)], theta[0])

    def estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        way = self.side * context.q[:, context.row(location)]
        edge = self.side * (float(way.max()) - theta[0])
        stiffness = super().estimates(context, location, theta, fit)["stiffness"]
        return {"stiffness": stiffness, self._edge: Estimate(edge, None, "rad")}

    def in_mujoco(self, item: Sizes) -> Form:
        note = Spring(taut=item.value("stiffness"), **{self._edge: item.value(self._edge)})
        return Form(notes=(Noted(self.name, item.location, note),))

    @property
    def _edge(self) -> str:
        return "above" if self.side > 0.0 else "below"


def pulls_often(way: Array, depth: float) -> bool:
    """Whether what pushes back beyond an edge does so over much of a motion, though not all: no stop does.

    Args:
        way: ``(n_samples,)`` positions towards it [rad].
        depth: how far the largest lies beyond the edge [rad].
    """
    beyond = float(np.mean(way > way.max() - depth))
    return _OFTEN <= beyond <= 1.0 - _LEAST_SLACK


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
