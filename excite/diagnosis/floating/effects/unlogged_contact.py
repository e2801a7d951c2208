"""A hand or a knee rests on something that nobody logged."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, links, points, segment_of
from excite.diagnosis.floating.state import State
from excite.robot.robot import Array


class UnloggedContact(FloatingEffect):
    """A world force at a point of the link while the contact lasts; when it lasts is learnt from the record.

    ``share (n,)``, between 0 and 1, says when: a member made without it has no places. ``coarse`` is the same
    for a thinned record; ``price`` is that of the moments at which it comes and goes.
    """

    name: ClassVar[str] = "unlogged_contact"
    reads_as: ClassVar[str] = "any force that comes and goes; two levels, and the same link each time"

    def __init__(self, share: Array | None = None, coarse: Array | None = None, price: float = 0.0):
        self.share, self.coarse, self.price = share, coarse, price

    def locations(self, state: State) -> tuple[str, ...]:
        """Links, once it is known when there was a contact."""
        return () if self.share is None else links(state)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The force while in contact, world frame, and the point in the link's frame."""
        force = tuple(Parameter(axis, "N", 25.0, 1.0) for axis in ("fx", "fy", "fz"))
        return (*force, *points())

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Add it."""
        known = [share for share in (self.share, self.coarse) if share is not None]
        share = next((share for share in known if len(share) == len(state.q)), np.zeros(len(state.q)))
        point = state.poses.point(segment_of(state, location) + 1, theta[3:])
        return state.but(extra=state.extra + state.at_base(share[:, None] * theta[:3], point))
