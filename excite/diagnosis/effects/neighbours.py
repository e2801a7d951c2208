"""Effects of a neighbouring joint: cross-talk of torque sensors, and motors that turn with the joint before theirs."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.effect import Belief, Effect, Parameter, Shape, Theta
from excite.diagnosis.effects.form import Absence, Context, Draft, Form, Sizes
from excite.diagnosis.equations.dry_friction.friction_sign import of_velocity
from excite.doctor.doubt import Doubt

# A torque sensor that feels its neighbours' torques.


class TorqueCrosstalk(Effect):
    """``τ_logged,j = τ_j + c₋ τ_{j−1} + c₊ τ_{j+1}``; the columns are predicted torques."""

    name = "torque_crosstalk"
    belief = Belief(chance=0.01, width=0.05)
    observed_by = frozenset({Doubt.SIZE})
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter("from_previous", "1", -0.5, 0.5),
        Parameter("from_next", "1", -0.5, 0.5),
    )
    confusable_with = ("torque_gain", "payload", "link_length_error")
    separating_motion = "a neighbour alone, loaded and unloaded, while the joint stands"
    mujoco = "none: a motor's force is that of its own joint"

    def is_candidate(self, modelled: tuple[str, ...]) -> bool:
        """Beside given bodies alone: a part of a neighbour's torque is a part of bodies' that are fitted."""
        return "rigid_body" not in modelled and super().is_candidate(modelled)

    def unit_torques(self, context: Context, location: str, theta: Theta) -> Array:
        j, torque = context.row(location), context.baseline.total
        nothing = np.zeros((len(torque), 1))
        beside = np.hstack([nothing, torque, nothing])
        return beside[:, [j, j + 2]]

    def in_mujoco(self, item: Sizes) -> Form:
        return Form(absent=Absence.SENSOR)


# A wrist whose motor turns with the joint before it.


class CoupledDrive(Effect):
    """A joint's motor turns with ``u = v_j + c v_{j−1}``: its friction acts along both joints.

    ``φ = f_c sign(u) + f_v u`` is added to joint j and ``c φ`` to the joint before it. Wrists whose motors sit before
    the joint that carries them are built so: Stäubli's TX with c = 1.
    """

    name = "coupled_drive"
    belief = Belief(chance=0.01)
    linear: ClassVar[tuple[Parameter, ...]] = (
        Parameter("coulomb", "N·m", 0.0),
        Parameter("viscous", "N·m·s/rad"),
    )
    searched: ClassVar[tuple[Parameter, ...]] = (Parameter("ratio", "1", -3.0, 3.0),)
    confusable_with = ("torque_crosstalk", "coulomb_friction", "viscous_friction")
    separating_motion = "the joint before it alone, slowly, to and fro"
    mujoco = "a tendon of both joints with dry friction, damping and armature"
    own_joint = False
    reaches_others = True

    @property
    def variant_forms(self) -> tuple[Effect, ...]:
        return (CoupledRotor(),)

    def locations(self, context: Context) -> tuple[str, ...]:
        return context.joints[1:]

    def search_grid(self, context: Context, location: str) -> list[Theta]:
        return [(1.0,), (-1.0,)]

    def shape(self, context: Context, location: str, theta: Theta) -> Shape:
        j, ratio = context.row(location), theta[0]
        speed, rate = self._motor_motion(context, location, theta)
        columns = np.column_stack([of_velocity(speed, context.baseline.signs[j]), speed, rate])
        columns = columns[:, : len(self.linear)]
        return Shape({j - 1: ratio * columns, j: columns})

    def is_admissible(self, context: Context, location: str, theta: Theta, beta: Array) -> bool:
        # Small next to the dry friction, the viscous one may come out below zero: friction as a whole brakes.
        speed, _ = self._motor_motion(context, location, theta)
        brakes = float(beta[0] * np.abs(speed).mean() + beta[1] * (speed**2).mean()) > 0.0
        return brakes and self.in_bounds(beta, np.zeros(len(beta)))

    def _motor_motion(self, context: Context, location: str, theta: Theta) -> tuple[Array, Array]:
        """Speed and acceleration of the motor, in turns of its joint, each ``(n_samples,)``."""
        j = context.row(location)
        return context.v[:, j] + theta[0] * context.v[:, j - 1], context.a[:, j] + theta[0] * context.a[
            :, j - 1
        ]

    def in_mujoco(self, item: Sizes) -> Form:
        before = item.joints[item.joints.index(item.location) - 1]

        def add_coupling_tendon(draft: Draft) -> None:
            tendon = draft.spec.add_tendon(
                name=f"{item.location}.coupling",
                frictionloss=max(item.value_of("coulomb"), 0.0),
                damping=[max(item.value_of("viscous"), 0.0), 0.0, 0.0],
                armature=max(item.value_of("inertia"), 0.0),
            )
            tendon.wrap_joint(item.location, 1.0)
            tendon.wrap_joint(before, item.value_of("ratio"))

        return Form(elements=add_coupling_tendon)


class CoupledRotor(CoupledDrive):
    """The same with the motor's rotor, ``φ = f_c sign(u) + f_v u + I_a u̇``.

    Links that are a little lighter to turn than modelled make a rotor less than none, which hides no friction.
    """

    linear = (*CoupledDrive.linear, Parameter("inertia", "kg·m²", 0.0))

    @property
    def variant_forms(self) -> tuple[Effect, ...]:
        return ()
