"""Something pulls at a link: a cable, a tether, a hand."""

from __future__ import annotations

from typing import ClassVar

from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, links, points, segment_of
from excite.diagnosis.floating.state import State
from excite.robot.robot import Array


class ExternalForce(FloatingEffect):
    """A force at a point p of the link, constant in the world but for a spring: F − k (p − mean p).

    Where on the link it is hooked is not known; the link's origin is but the likeliest place.
    """

    name: ClassVar[str] = "external_force"
    reads_as: ClassVar[str] = "sensor bias (the unloaded foot tells), base orientation (bend and turn)"

    def locations(self, state: State) -> tuple[str, ...]:
        """Links."""
        return links(state)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Mean force in the world, stiffness, and the point in the link's frame."""
        force = tuple(Parameter(axis, "N", 15.0, 1.0) for axis in ("fx", "fy", "fz"))
        return (*force, Parameter("stiffness", "N/m", 30.0, 1.0), *points())

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Add it."""
        point = state.poses.point(segment_of(state, location) + 1, theta[4:])
        force = theta[:3] - theta[3] * (point - point.mean(axis=0))
        return state.but(extra=state.extra + state.at_base(force, point))
