"""A base that does not stand as the model says."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.bodies.level_axes import level_axes
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.forces.torque_ripple import Wave
from excite.diagnosis.effects.form import Form, Sizes
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.units import slides
from excite.doctor.doubt import Doubt

_G = 9.81
# Distance of link 1's centre of mass from its axis that nobody knew of, with the whole robot's mass in it [m].
_LEVER = 0.1
# A tilt that is not seen for the noise [m/s²].
_LEAST = 0.02


def tilted(gravity: Array, item: Sizes) -> Array:
    """Gravity ``(3,)`` in a tilted base [m/s²]: its components are along the axes that the effect is fitted in."""
    size, (first, second, down) = float(np.linalg.norm(gravity)), level_axes(gravity)
    aside = item.value("gravity_x") * first + item.value("gravity_y") * second
    # A tilt turns gravity, it does not add to it; but masses that were fitted beside what is left of it go with that.
    less = float(np.sqrt(max(size**2 - float(aside @ aside), 0.0))) - size
    return (size + item.value("gravity_down", less)) * down + aside


class BaseTilt(Effect):
    """Gravity in the base frame has level components that the model does not have: along x and y on a level base.

    Two columns are the torques of a horizontal gravity; two more, cos q₁ and sin q₁ on the first row, are
    the first moments of link 1, invisible while its axis is upright. They are no larger than the tilt and the
    robot's mass make them, or a spring at joint 1 would be a tilt of nothing.
    """

    name = "base_tilt"
    told_by = frozenset({Doubt.POSITION, Doubt.GRAVITY})
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter("gravity_x", "m/s²", -5.0, 5.0),
        Parameter("gravity_y", "m/s²", -5.0, 5.0),
        Parameter("first_row_cosine", "N·m", beside=True),
        Parameter("first_row_sine", "N·m", beside=True),
    )
    confusable_with = ("joint_spring", "torque_bias", "encoder_offset")
    separating_motion = "a wide range of joint 1; the arm on a base that is turned"
    mujoco = "option gravity"
    moves = True
    by_motion = True
    note = Wave

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (SteepTilt(),)

    @property
    def forms(self) -> tuple[Effect, ...]:
        return (KnownLeverTilt(),)

    def offered(self, modelled: tuple[str, ...]) -> bool:
        return self.name not in modelled

    def locations(self, context: Context) -> tuple[str, ...]:
        return ("base",)

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        samples = context.baseline.samples
        model = samples.robot.model.copy()
        q = samples.stacked("q")
        still = np.zeros((len(q), model.nv))
        columns = np.zeros((len(q), len(context.joints), len(self.linear)))
        for k, axis in zip((0, 1, 4), level_axes(model.gravity.linear), strict=True):
            if k < len(self.linear):
                model.gravity.linear = axis
                columns[:, :, k] = context.torques(q, still, still, model)
        # A slide has no first moments; those of links further out are the identifier's.
        lever = len(self.linear) > 2
        if lever and samples.index[0] == 0 and not slides(samples.robot, context.joints[0]):
            first = context.q[:, 0]
            columns[:, 0, 2], columns[:, 0, 3] = np.cos(first), np.sin(first)
        return Shape({j: columns[:, j] for j in range(len(context.joints))})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        mass = sum(inertia.mass for inertia in context.baseline.samples.robot.model.inertias)
        most = _LEVER * mass * max(float(np.hypot(*beta[:2])), _LEAST)
        return float(np.linalg.norm(beta[2:4])) <= most and super().admissible(context, location, theta, beta)

    def estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        # A slide that is level shows one of the two, or none.
        shown = np.isfinite(fit.extra_std[:2])
        aside, spread = fit.extra[:2][shown], fit.extra_std[:2][shown]
        # Of no tilt nobody knows the direction: any is as likely.
        size = float(np.linalg.norm(aside))
        along = aside / size if size > 0.0 else np.full(len(aside), len(aside) ** -0.5)
        std = float(np.linalg.norm(along * spread)) / _G if shown.any() else None
        angle = Estimate(float(np.arcsin(min(size / _G, 1.0))), std, "rad")
        found = super().estimates(context, location, theta, fit)
        return {"angle": angle, **{p.name: found[p.name] for p in self.linear[:2] if p.name in found}}

    def in_mujoco(self, item: Sizes) -> Form:
        first = {name: item.value(f"first_row_{name}") for name in ("cosine", "sine")}
        noted = self.noted(replace(item, values={**first, "periods_per_rev": 1.0}), item.joints[0])
        notes = (noted,) if any(first.values()) else ()
        return Form(gravity=lambda gravity: tilted(gravity, item), notes=notes)


class KnownLeverTilt(BaseTilt):
    """The same with a first link as it is known: beside a large effect at joint 1, its first moments are nowhere."""

    linear = BaseTilt.linear[:2]

    @property
    def richer(self) -> tuple[Effect, ...]:
        return (BaseTilt(),)

    @property
    def forms(self) -> tuple[Effect, ...]:
        return ()


class SteepTilt(BaseTilt):
    """The same where the tilt is large enough for less of gravity to be left along the nominal vertical."""

    linear = (*BaseTilt.linear, Parameter("gravity_down", "m/s²", -5.0, 0.0))

    @property
    def richer(self) -> tuple[Effect, ...]:
        return ()
