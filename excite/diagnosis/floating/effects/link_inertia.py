"""A link's inertial parameters are wrong, or it carries a body that the model lacks."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, links, segment_of
from excite.diagnosis.floating.effects.form import Part
from excite.diagnosis.floating.equations.state import State
from excite.doctor.doubt import Doubt

_NAMES = ("mass", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_UNITS = ("kg", "kg·m", "kg·m", "kg·m") + ("kg·m²",) * 6


class LinkInertia(FloatingEffect):
    """True parameters = the model's + error; also what a payload does, which is a positive error."""

    name: ClassVar[str] = "link_inertia"
    told_by = frozenset({Doubt.POSITION, Doubt.GRAVITY, Doubt.CLOCK, Doubt.SIZE})
    reads_as: ClassVar[str] = "constant sensor bias, and the neighbouring links where they move as one"
    confusable_with: ClassVar[tuple[str, ...]] = ("sensor_bias",)
    says = Part.BODIES
    mujoco: ClassVar[str] = "body mass, pos and inertia"

    def locations(self, state: State) -> tuple[str, ...]:
        """Links with mass, where the inertial parameters are not identified anyway."""
        return () if state.record.inertials_free else links(state)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The ten parameters' errors about the joint's frame."""
        mass = 0.05 * state.record.tree.phi[::10].sum()
        own = state.record.tree.phi[10 * segment_of(state, location)]
        mass = min(mass, 1.0 + 0.3 * own)
        scales = (mass,) + (0.1 * mass,) * 3 + (0.01 * mass,) * 6
        return tuple(Parameter(n, u, s, 0.1 * s) for n, u, s in zip(_NAMES, _UNITS, scales, strict=True))

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Change the parameters."""
        first = 10 * segment_of(state, location)
        phi = state.phi.copy()
        phi[first : first + 10] += theta
        return state.replace(phi=phi)

    def columns(self, state: State, location: str, theta: Array) -> Array:
        """Columns of the regressor."""
        first = 10 * segment_of(state, location)
        return np.asarray(state.regressor[:, :, first : first + 10])

    def report(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """The ten errors, and the centre of mass of what is too much."""
        mass = float(theta[0])
        extra = {
            f"com_{axis}": Estimate(float(theta[1 + i]) / mass, float(std[1 + i]) / abs(mass), "m")
            for i, axis in enumerate("xyz")
            if mass
        }
        return super().report(state, location, theta, std) | extra

    def called(self, theta: Array) -> str:
        """A payload is what adds mass."""
        return "payload" if theta[0] > 0.0 else self.name
