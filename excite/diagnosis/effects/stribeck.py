"""Stribeck friction: more friction at low speed."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.diagnosis.candidate import Estimate
from excite.diagnosis.effects.effect import Context, Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.presliding import hysteretic_sign
from excite.diagnosis.equations import Fit
from excite.robot.robot import Array

# A Stribeck velocity nearer to the width of the sign change says how friction changes sign, no more.
_APART = 2.5
# Nor does one that is over while bristles still bend, which takes joints to about this speed [rad/s].
_BENT = 0.03


class Stribeck(Effect):
    """``τ = f_s exp(−(|v|/v_s)²) sign(v)`` (Armstrong-Hélouvry et al. 1994, eq. 3; exponent 2)."""

    name = "stribeck"
    linear: ClassVar[tuple[Parameter, ...]] = (Parameter("excess", "N·m", 0.0),)
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("velocity", "rad/s", 5e-3, 0.5),)
    confusable_with = ("coulomb_friction", "load_dependent_friction", "backlash")
    separating_motion = "constant speeds from below the Stribeck velocity to well above it"
    mujoco = "none of its own: a control callback"
    friction = True

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (StribeckExponential(), StribeckExponent(), StribeckBristles())

    def grid(self, context: Context, location: str) -> list[Theta]:
        return [(v,) for v in (0.015, 0.03, 0.06, 0.12, 0.25)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: (context.sign(j) * np.exp(-((context.v[:, j] / theta[0]) ** 2)))[:, None]})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        base, j = context.baseline, context.row(location)
        least = _BENT if base.breakaways[j] > 0.0 else _APART * float(base.widths[j])
        return theta[0] >= least and super().admissible(context, location, theta, beta)


class StribeckExponential(Stribeck):
    """``τ = f_s exp(−|v|/v_s) sign(v)`` (Tustin 1947)."""

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        return [theta, (0.6 * theta[0],)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        return Shape({j: (context.sign(j) * np.exp(-np.abs(context.v[:, j]) / theta[0]))[:, None]})

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
        j = context.row(location)
        decay = np.exp(-((np.abs(context.v[:, j]) / theta[0]) ** theta[1]))
        return Shape({j: (context.sign(j) * decay)[:, None]})


class StribeckBristles(Stribeck):
    """Stribeck friction that builds up over a deflection, as Coulomb friction then does as well."""

    linear = (*Stribeck.linear, Parameter("presliding", "N·m", 0.0))
    searched = (*Stribeck.searched, Parameter("breakaway", "rad", 1e-4, 2e-2))

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()

    def starts(self, theta: Theta) -> list[Theta]:
        return [(theta[0], 5e-4), (theta[0], 2e-3)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j = context.row(location)
        sign = hysteretic_sign(context, j, theta[1])
        decay = np.exp(-((context.v[:, j] / theta[0]) ** 2))
        return Shape({j: np.column_stack([sign * decay, sign - context.sign(j)])})
