"""A body on a link that the model does not have."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.bodies.likeliest_body import likeliest_body
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
# Distance of a body's centre from the joint that carries it [m]: no gripper or tool of the records is longer.
_REACH = 0.6


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
        kept[key] = np.abs(link_columns(context, joint)).max(axis=0) > 1e-12
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
        """Whether link and body together have no negative mass, and the body's centre lies within reach."""
        joint = self.locations(context).index(location) + 1
        link = float(context.baseline.samples.robot.model.inertias[joint].mass)
        moment = float(np.linalg.norm(beta[1:4]))
        # Without a mass of its own, moments are all that was seen.
        return beta[0] == 0.0 or (link + beta[0] >= 0.0 and moment <= _REACH * abs(float(beta[0])))

    def nearest_body(
        self, context: Context, location: str, information: Array, target: Array
    ) -> Array | None:
        joint = self.locations(context).index(location) + 1
        link = float(context.baseline.samples.robot.model.inertias[joint].mass)
        return likeliest_body(information, target, _REACH, link)

    def physical(self, context: Context, location: str, fit: Fit) -> bool:
        """Whether link and body together may have their mass: less than none is another effect's doing."""
        joint = self.locations(context).index(location) + 1
        mass = float(context.baseline.phi[10 * (joint - 1)]) + float(fit.extra[0])
        return mass > -_SURELY * float(fit.extra_std[0])

    def estimates(self, context: Context, location: str, theta: Theta, fit: Fit) -> dict[str, Estimate]:
        """What the joints feel of the body; where they do not feel its mass, its first moment comes first."""
        found = super().estimates(context, location, theta, fit)
        felt = np.any(_felt(context, self.locations(context).index(location) + 1), axis=0)
        shown = {name: item for (name, item), here in zip(found.items(), felt, strict=True) if here}
        if felt[0] or not felt[1:4].any():
            return shown
        moment, spread = fit.extra[1:4] * felt[1:4], fit.extra_std[1:4] * felt[1:4]
        size = float(np.linalg.norm(moment))
        std = float(np.linalg.norm(moment * spread) / max(size, 1e-300))
        return {"first_moment": Estimate(size, std, "kg·m")} | shown

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(body=np.array([item.value(p.name) for p in self.linear]))
