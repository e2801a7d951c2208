"""A hand or a knee rests on something that nobody logged."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from typing import Any, ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, links, points, segment_of
from excite.diagnosis.floating.effects.form import Beyond
from excite.diagnosis.floating.equations.record import FloatingRecord
from excite.diagnosis.floating.equations.state import State


class UnloggedContact(FloatingEffect):
    """A world force at a point of the link while the contact lasts; when it lasts is learnt from the record.

    ``share (n,)``, between 0 and 1, says when: a member made without it has no places. ``coarse`` is the same
    for a thinned record; ``price`` is that of the moments at which it comes and goes.
    """

    name: ClassVar[str] = "unlogged_contact"
    reads_as: ClassVar[str] = "any force that comes and goes; two levels, and the same link each time"
    confusable_with: ClassVar[tuple[str, ...]] = ("external_force",)
    says = Beyond.FORCES

    def __init__(self, share: Array | None = None, coarse: Array | None = None, price: float = 0.0):
        self.share, self.coarse, self.price = share, coarse, price

    def holds(self, record: FloatingRecord) -> dict[str, Any]:
        """When it lasts: by trial, how many samples in a row have which share."""
        spells = {}
        for trial, span in zip(record.trials, record.spans, strict=True):
            values = [round(float(x), 4) for x in self._share(record.n_samples)[span]]
            spells[trial] = [[len(list(run)), share] for share, run in groupby(values)]
        return {"spells": spells}

    def holding(self, said: Mapping[str, Any], record: FloatingRecord) -> UnloggedContact:
        """The contact that lasts as is said."""
        share = np.zeros(record.n_samples)
        for trial, span in zip(record.trials, record.spans, strict=True):
            runs = said["spells"].get(trial, [])
            values = np.repeat([run[1] for run in runs], [int(run[0]) for run in runs])
            share[span][: len(values)] = values[: span.stop - span.start]
        return UnloggedContact(share)

    def locations(self, state: State) -> tuple[str, ...]:
        """Links, once it is known when there was a contact."""
        return () if self.share is None else links(state)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The force while in contact, world frame, and the point in the link's frame."""
        force = tuple(Parameter(axis, "N", 25.0, 1.0) for axis in ("fx", "fy", "fz"))
        return (*force, *points())

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Add it."""
        share = self._share(len(state.q))
        point = state.poses.point(segment_of(state, location) + 1, theta[3:])
        return state.replace(extra=state.extra + state.at_base(share[:, None] * theta[:3], point))

    def _share(self, n: int) -> Array:
        """``(n,)`` share of a record with so many samples."""
        known = [share for share in (self.share, self.coarse) if share is not None]
        return next((share for share in known if len(share) == n), np.zeros(n))
