"""A body on a link that the model does not have."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.bodies.likeliest_body import exists, likeliest_body
from excite.diagnosis.effects.bodies.reach import reach
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Form, Sizes
from excite.diagnosis.equations.joint_torque import Fit
from excite.diagnosis.equations.own_columns import ARMATURE
from excite.doctor.doubt import Doubt
from excite.regressor.kernels import joint_torque_regressor
from excite.robot.links import carried_link

# Standard deviations, told for white residuals, by which a mass is below zero that cannot be.
_SURELY = 6.0
# Share of its torques that a body's mass and first moments have at least.
_WEIGHTLESS = 0.05
# Share of its torques by which numbers may miss a body that can exist: what a solver leaves.
_MISSED = 1e-3
# Columns smaller than this share of the largest one are rounding errors, as they are where hypotheses are fitted.
_NOTHING = 1e-7
# Share of what a number may be a priori from which a record says nothing of it.
_UNTOLD = 0.5


def link_columns(context: Context, joint: int) -> Array:
    """Torques per unit of the ten inertial parameters of the body after a joint, ``(n, n_joints, 10)``."""
    s = context.baseline.samples
    key, kept = "regressor", s.kept
    if key not in kept:
        motion = (s.stacked(name) for name in ("q", "v", "a"))
        kept[key] = s.of_joints(joint_torque_regressor(s.robot.model, *motion))
    return np.asarray(kept[key][:, :, 10 * (joint - 1) : 10 * joint])


def _felt(context: Context, joint: int) -> NDArray[np.bool_]:
    """Which joints feel which of these parameters, ``(n_joints, 10)``."""
    kept = context.baseline.samples.kept
    key = "felt of a body", joint
    if key not in kept:
        largest = np.abs(link_columns(context, joint)).max(axis=0)
        kept[key] = largest > max(_NOTHING * float(largest.max()), 1e-12)
    return np.asarray(kept[key])


def _power(context: Context, joint: int) -> Array:
    """Products of these columns with each other, over all samples and joints, ``(10, 10)``."""
    key, kept = ("power of a body", joint), context.baseline.samples.kept
    if key not in kept:
        columns = link_columns(context, joint).reshape(-1, 10)
        kept[key] = columns.T @ columns
    return np.asarray(kept[key])


class Payload(Effect):
    """The regressor's columns of one body: mass, first moments, inertia (Atkeson, An, Hollerbach 1986)."""

    name = "payload"
    told_by = frozenset({Doubt.POSITION, Doubt.GRAVITY, Doubt.CLOCK, Doubt.SIZE})
    linear = tuple(
        Parameter(n, u, width=w)
        for n, u, w in zip(
            ("mass", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"),
            ("kg", *["kg·m"] * 3, *["kg·m²"] * 6),
            # A heavy body within half a metre: says nothing but where the motion does not show it.
            (20.0, *[10.0] * 3, *[5.0] * 6),
            strict=True,
        )
    )
    confusable_with = ("link_inertia", "torque_gain")
    separating_motion = "the same motion without the load; wide wrist motion for the place"
    without_motion = "the same motion without the load, or a scale"
    mujoco = "body mass, pos and inertia"
    moves = True
    by_motion = True
    is_body = True

    def offered(self, modelled: tuple[str, ...]) -> bool:
        return "rigid_body" not in modelled and self.name not in modelled

    def locations(self, context: Context) -> tuple[str, ...]:
        model = context.baseline.samples.robot.model
        return tuple(carried_link(model, k) for k in range(1, model.njoints))

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        joint = self.locations(context).index(location) + 1
        columns, felt = link_columns(context, joint), _felt(context, joint)
        return Shape({j: columns[:, j] for j in range(columns.shape[1]) if felt[j].any()})

    def admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        """Whether it has weight: one that has inertia alone is a rotor that the model lacks."""
        if ARMATURE.asked(context.baseline.modelled):
            return True
        power = _power(context, self.locations(context).index(location) + 1)
        torque, weight = float(beta @ power @ beta), float(beta[:4] @ power[:4, :4] @ beta[:4])
        return weight > _WEIGHTLESS**2 * torque

    def possible(self, context: Context, location: str, beta: Array) -> bool:
        """Whether they are a body's that can exist, or what a link may lack of its own.

        Of numbers that the motion does not show any will do: a body's mass on an axis that turns about itself.
        """
        model, joint = context.baseline.samples.robot.model, self.locations(context).index(location) + 1
        most, link = reach(model), float(model.inertias[joint].mass)
        if exists(beta, most, link):
            return True
        power = _power(context, joint)
        found = likeliest_body(power, power @ beta, most, link)
        if found is None:
            return False
        missed = found - beta
        return float(missed @ power @ missed) <= _MISSED**2 * float(beta @ power @ beta)

    def nearest_body(
        self, context: Context, location: str, information: Array, target: Array
    ) -> Array | None:
        model, joint = context.baseline.samples.robot.model, self.locations(context).index(location) + 1
        return likeliest_body(information, target, reach(model), float(model.inertias[joint].mass))

    def physical(self, context: Context, location: str, fit: Fit) -> bool:
        """Whether link and body together may have their mass: less than none is another effect's doing."""
        joint = self.locations(context).index(location) + 1
        mass = float(context.baseline.phi[10 * (joint - 1)]) + float(fit.extra[0])
        return mass > -_SURELY * float(fit.extra_std[0])

    def estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        """What the joints tell of the body; where they do not tell its mass, its first moment comes first."""
        found = super().estimates(context, location, theta, fit)
        felt = np.any(_felt(context, self.locations(context).index(location) + 1), axis=0)
        told = felt & (fit.extra_std < _UNTOLD * self.widths)
        shown = {p.name: found[p.name] for p, here in zip(self.linear, told, strict=True) if here}
        if told[0] or not told[1:4].any():
            return shown
        moment, spread = fit.extra[1:4] * told[1:4], fit.extra_std[1:4] * told[1:4]
        size = float(np.linalg.norm(moment))
        std = float(np.linalg.norm(moment * spread) / max(size, 1e-300))
        return {"first_moment": Estimate(size, std, "kg·m")} | shown

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(body=np.array([item.value(p.name) for p in self.linear]))
