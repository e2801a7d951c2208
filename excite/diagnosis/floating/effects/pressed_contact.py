"""A hand or a knee is pressed on something soft that nobody logged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, links, points, segment_of
from excite.diagnosis.floating.state import State
from excite.robot.robot import Array

# Below this speed friction is in proportion to it.
_STANDSTILL_M_S = 0.05


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
    soft things, which never are fully on or off, have their form too. The force is larger while the point
    sinks than while it rises (Hunt and Crossley 1975, eq. 10), and the surface rubs against the point's motion
    along it (Coulomb, smoothed about standstill).
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
        shape = (Parameter("raised", "m", 0.05, 1e-3), Parameter("deeper", "1", 0.7, 0.02))
        moving = (Parameter("friction", "1", 0.3, 0.01), Parameter("damping", "s/m", 0.5, 0.02))
        return (*force, *points(), *shape, *moving)

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Add it."""
        point = state.poses.point(segment_of(state, location) + 1, theta[3:6])
        normal = np.array(self.surface.normal)
        share = self.surface.share(point @ normal, theta[6], theta[7])
        force = share[:, None] * theta[:3]
        if theta[8:].any():
            speed = _speed(state, point)
            sinking = -(speed @ normal)
            sliding = speed + sinking[:, None] * normal
            smooth = np.sqrt((sliding**2).sum(axis=1) + _STANDSTILL_M_S**2)
            rubs = theta[8] * share * float(theta[:3] @ normal) / smooth
            force = (force - rubs[:, None] * sliding) * np.maximum(0.0, 1.0 + theta[9] * sinking)[:, None]
        return state.but(extra=state.extra + state.at_base(force, point))


def _speed(state: State, point: Array) -> Array:
    """``(n, 3)`` velocity of a point by central differences within each trial [m/s]."""
    spans, rate = state.record.spans, state.record.rate_hz
    return np.concatenate([np.gradient(point[span], 1.0 / rate, axis=0) for span in spans])
