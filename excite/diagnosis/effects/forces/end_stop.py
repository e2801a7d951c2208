"""A stop that a joint runs into, or a body that the arm touches there: physics that no name of a diagnosis has."""

from __future__ import annotations

from typing import ClassVar

from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Effect, Theta
from excite.diagnosis.effects.forces.joint_spring import LowerSlackSpring, SlackSpring
from excite.diagnosis.effects.forces.one_sided import OneSided


class EndStop(OneSided):
    """``τ = k max(q − edge, 0)`` over a small part of a joint's travel."""

    name = "end_stop"
    nameless = "position"
    first: ClassVar[tuple[float, ...]] = (0.05, 0.12, 0.22, 0.35)
    within: ClassVar[tuple[float, float]] = (0.0, 0.45)

    @property
    def forms(self) -> tuple[Effect, ...]:
        return (LowerEndStop(),)

    def mirrored(self, context: Context, location: str, theta: Theta) -> tuple[Effect, Theta]:
        """A spring that is slack where this pushes: weight and a constant take up what grows with the position."""
        other = LowerSlackSpring() if self.side > 0.0 else SlackSpring()
        return other, self.beyond_edge(context, location, theta)


class LowerEndStop(EndStop):
    """The same at the other end of the travel."""

    side: ClassVar[float] = -1.0

    @property
    def forms(self) -> tuple[Effect, ...]:
        return ()
