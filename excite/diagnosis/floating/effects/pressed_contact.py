"""A hand or a knee is pressed on something soft that nobody logged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, links, points, segment_of
from excite.diagnosis.floating.state import State
from excite.robot.robot import Array


@dataclass(frozen=True)
class Surface:
    """Something that pushes back along ``normal`` what comes nearer than ``height``.

    Attributes:
        normal: world unit vector, out of it.
        height: along the normal, at which it is first touched [m].
        depth: over which its force rises [m].
        rounded: whether the force rises smoothly and not in proportion.
    """

    normal: tuple[float, float, float]
    height: float
    depth: float
    rounded: bool

    def share(self, along: Array, raised: float = 0.0, deeper: float = 0.0) -> Array:
        """Share of its largest force at positions ``along`` the normal.

        Args:
            along: ``(…)`` [m].
            raised: added to the height [m].
            deeper: logarithm of a factor on the depth.
        """
        s = np.clip((self.height + raised - along) / (self.depth * np.exp(deeper)), 0.0, 1.0)
        return s**2 * (3.0 - 2.0 * s) if self.rounded else s


class PressedContact(FloatingEffect):
    """A world force at a point of the link that rises as the point sinks into a surface.

    What :class:`UnloggedContact` learns instant by instant is here a function of where the point is, so that
    soft things, which never are fully on or off, have their form too.
    """

    name: ClassVar[str] = "unlogged_contact"
    reads_as: ClassVar[str] = "a spring, where the link never leaves it"

    def __init__(self, surface: Surface):
        self.surface = surface

    def locations(self, state: State) -> tuple[str, ...]:
        """Links."""
        return links(state)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The largest force, world frame; the point in the link's frame; what the first guess is off by."""
        force = tuple(Parameter(axis, "N", 25.0, 1.0) for axis in ("fx", "fy", "fz"))
        return (*force, *points(), Parameter("raised", "m", 0.05, 1e-3), Parameter("deeper", "1", 0.7, 0.02))

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Add it."""
        point = state.poses.point(segment_of(state, location) + 1, theta[3:6])
        share = self.surface.share(point @ np.array(self.surface.normal), theta[6], theta[7])
        return state.but(extra=state.extra + state.at_base(share[:, None] * theta[:3], point))
