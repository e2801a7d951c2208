"""Stribeck friction: more friction at low speed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.bristle import Bristle, Static
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Form, Sizes
from excite.diagnosis.effects.friction.presliding import bent_excess
from excite.diagnosis.effects.note import Beyond, JointStep, Note
from excite.diagnosis.equations.dry_friction.friction_sign import (
    SignChange,
    damping_of_bristles,
    sign_of_motion,
)
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.own_columns import COULOMB, coulomb_level

# A Stribeck velocity nearer to the width of the sign change says how friction changes sign, no more.
_APART = 2.5
# Nor does one that is over while bristles still bend, which takes joints to about this speed [rad/s].
_BENT = 0.03
# Share of the Coulomb level below which an excess says that bristles are not quite what the model has them be.
_TRIFLE = 0.05
# A search that ended within its last step, 1.3 per cent, of the slowest velocity that may be would go on to slower
# ones: of three simulated joints that stick (a UR3e's first, a Z1's fourth, the second of another arm) it ended at
# 1.000, 1.0006 and 1.010 of that.
_EDGE = 1.02
# Most of the Coulomb level that bristles may take over; the fit without them is off by a little.
_SHARE = 1.5
# Stribeck velocity that a search has to end below [rad/s], or below the joint's usual speed where that is faster. With
# 0.45 alone nothing is found of 20 N that a carriage of 0.7 m/s has more at rest, whose velocity is 0.45 or 0.6 m/s;
# with its usual speed 20.0 to 22.0 N are.
_SLOWER = 0.45
# Share of the excess by which Coulomb friction may be fitted below none.
_LEFT = 0.1


@dataclass(frozen=True)
class Slow(Note):
    """More dry friction at low speed, on the bristles that the joint's friction has, or on some of its own.

    Attributes:
        excess: at rest, over the level [N·m].
        velocity: Stribeck velocity [rad/s].
        exponent: of the decay; 2 where it is not given.
        presliding: of the level, what bristles of its own hold [N·m].
        breakaway: of these [rad].
        bristle_damping: of these [N·m·s].
    """

    excess: float
    velocity: float
    exponent: float | None = None
    presliding: float | None = None
    breakaway: float | None = None
    bristle_damping: float | None = None

    beyond = Beyond.FRICTION

    @property
    def rubs(self) -> bool:
        return True

    @cached_property
    def static(self) -> Static:
        """See :class:`Note`."""
        return Static(self.excess, self.velocity, 2.0 if self.exponent is None else self.exponent)

    def bristle(self) -> Bristle | None:
        if self.breakaway is None:
            return None
        return Bristle(self.breakaway, self.bristle_damping or 0.0, static=self.static)

    def held(self, level: Array) -> Array:
        # A fit may have bristles take less than none of a level, or more than all.
        return np.minimum(max(self.presliding or 0.0, 0.0), np.maximum(level, 0.0))

    def friction(self, level: Array, at: JointStep) -> tuple[Array, float]:
        if self.breakaway is not None:
            return level - self.held(level), 0.0
        if at.bends:
            return level, 0.0
        return level + self.static.excess * self.static.share(at.v), 0.0


class Stribeck(Effect):
    """``τ = f_s exp(−(|v|/v_s)²) sign(v)`` (Armstrong-Hélouvry et al. 1994, eq. 3; exponent 2)."""

    name = "stribeck"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("excess", "N·m", 0.0),)
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("velocity", "rad/s", 5e-3, 5.0),)
    confusable_with = ("coulomb_friction", "load_dependent_friction", "backlash")
    separating_motion = "constant speeds from below the Stribeck velocity to well above it"
    mujoco = "none of its own: a control callback"
    friction = True
    note = Slow

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (StribeckExponential(), StribeckExponent(), StribeckBristles())

    def grid(self, context: Context, location: str) -> list[Theta]:
        limit = _greatest(context, location)
        return [(v,) for v in (0.015, 0.03, 0.06, 0.12, 0.25, 0.5, 1.0, 2.0) if v <= max(0.5 * limit, 0.25)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        return _excess(context, location, theta[0])

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        base, j = context.baseline, context.row(location)
        if theta[0] < _slowest(base.signs[j]) or not super().admissible(context, location, theta, beta):
            return False
        trifle = beta[0] < _TRIFLE * coulomb_level(base.modelled, base.fit.own[j])
        return not (base.signs[j].bent and trifle)

    def settled(self, context: Context, location: str, theta: Theta, fit: Fit) -> bool:
        """Friction that falls with speed up to the joint's usual one is no matter of low speed.

        Nor is what leaves no dry friction above it: there drag sets in that grows faster than with the speed. At the
        slowest velocity that may be a search says how a joint sticks.
        """
        slowest = max(_slowest(context.baseline.signs[context.row(location)]), self.searched[0].low)
        left = coulomb_level(context.baseline.modelled, fit.own[context.row(location)])
        within = _EDGE * slowest < theta[0] < _greatest(context, location)
        return within and left > -_LEFT * float(fit.extra[0])

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(notes=(self.noted(item),))


class StribeckExponential(Stribeck):
    """``τ = f_s exp(−|v|/v_s) sign(v)`` (Tustin 1947)."""

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        return [theta, (0.6 * theta[0],)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        return _excess(context, location, theta[0], exponent=1.0)

    def estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        return super().estimates(context, location, theta, fit) | {"exponent": Estimate(1.0, None, "1")}


class StribeckExponent(Stribeck):
    """``τ = f_s exp(−(|v|/v_s)^δ) sign(v)`` with the exponent δ searched (Bo, Pavelescu 1982)."""

    searched = (*Stribeck.searched, Parameter("exponent", "1", 0.4, 2.5))

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        return [(theta[0], 1.2), (0.7 * theta[0], 0.7)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        return _excess(context, location, theta[0], exponent=theta[1])


class StribeckBristles(Stribeck):
    """Stribeck friction that builds up over a deflection, as Coulomb friction then does as well.

    The LuGre model (Canudas de Wit et al. 1995), for joints whose dry friction was not seen to have bristles, or others
    where static friction was not thought of.
    """

    linear = (
        *Stribeck.linear,
        Parameter("presliding", "N·m", 0.0, beside=True),
        Parameter("bristle_damping", "N·m·s", 0.0, beside=True),
    )
    searched = (*Stribeck.searched, Parameter("breakaway", "rad", 1e-4, 2e-2))

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        return [(theta[0], 5e-4), (theta[0], 2e-3)]

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        """Bristles that bend nearly like the baseline's can have any share of the level: no more than there is."""
        base, j = context.baseline, context.row(location)
        level = coulomb_level(base.modelled, base.fit.own[j])
        too_much = COULOMB.asked(base.modelled) and beta[1] > _SHARE * max(level, 0.0)
        return not too_much and super().admissible(context, location, theta, beta)

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        velocity, breakaway = theta
        samples, bristles = context.baseline.samples, SignChange(0.0, breakaway, np.inf)
        sign = sign_of_motion(samples, j, bristles)
        excess = bent_excess(context, j, bristles, velocity, 2.0)
        damped = damping_of_bristles(samples, j, bristles)
        return Shape({j: np.column_stack([excess, sign - context.sign(j), damped])})


def _excess(context: Context, location: str, velocity: float, exponent: float = 2.0) -> Shape:
    """More friction at low speed; while bristles bend, where the joint's friction has some."""
    j = context.row(location)
    sign = context.baseline.signs[j]
    if sign.bent:
        return Shape({j: bent_excess(context, j, sign, velocity, exponent)[:, None]})
    decay = np.exp(-((np.abs(context.v[:, j]) / velocity) ** exponent))
    return Shape({j: (context.sign(j) * decay)[:, None]})


def _slowest(sign: SignChange) -> float:
    """Stribeck velocity below which friction's change of sign would be told [rad/s]."""
    return _BENT if sign.bent else _APART * sign.width


def _greatest(context: Context, location: str) -> float:
    """Stribeck velocity that is told from friction that falls with speed throughout [rad/s]."""
    v = context.v[:, context.row(location)]
    return max(_SLOWER, float(np.sqrt((v**2).mean())))
